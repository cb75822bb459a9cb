//! A file of settings: TOML with one key for each setting, and no tables.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use toml::{Spanned, Value};
use zk0_files::bounded_file;

/// Largest file that is read, in bytes.
const MAX_FILE_BYTES: u64 = 1 << 20;

/// The file, as errors name it.
#[derive(Default)]
pub(super) struct SettingsFile(PathBuf);

/// What the file says of one setting.
pub(super) struct FileSetting {
    pub key: String,
    /// Where the file says it, counted from 1.
    pub line: usize,
    value: Value,
}

impl SettingsFile {
    /// Reads the settings of the file, in the order of their lines. The error says what is wrong with it, and where.
    pub fn read(path: &Path) -> Result<(Self, Vec<FileSetting>), String> {
        let named = |why: &dyn std::fmt::Display| format!("{}: {why}", path.display());
        let bytes = bounded_file::read(path, MAX_FILE_BYTES).map_err(|error| named(&error))?;
        let text = String::from_utf8(bytes).map_err(|error| named(&error))?;
        let parsed: BTreeMap<Spanned<String>, Spanned<Value>> =
            toml::from_str(&text).map_err(|error| named(&error))?;
        let mut settings: Vec<_> = parsed
            .into_iter()
            .map(|(key, value)| FileSetting {
                line: text[..key.span().start].matches('\n').count() + 1,
                key: key.into_inner(),
                value: value.into_inner(),
            })
            .collect();
        settings.sort_by_key(|setting| setting.line);
        Ok((Self(path.into()), settings))
    }

    /// The name of the file.
    pub fn name(&self) -> std::path::Display<'_> {
        self.0.display()
    }

    /// An error about a setting.
    pub fn says(&self, setting: &FileSetting, why: &str) -> String {
        let FileSetting { key, line, .. } = setting;
        format!("{}, line {line}: {key}: {why}", self.name())
    }
}

impl FileSetting {
    /// The value of a setting that is on or off.
    pub fn flag(&self) -> Result<bool, &'static str> {
        let wrong = "this setting is true or false, without quotation marks";
        self.value.as_bool().ok_or(wrong)
    }

    /// The values of a setting that may have several.
    pub fn list(&self) -> Result<Vec<String>, &'static str> {
        let wrong = "this setting is a list, such as [\"one\", \"other\"]";
        let values = self.value.as_array().ok_or(wrong)?;
        values
            .iter()
            .map(|value| text(value).ok_or(wrong))
            .collect()
    }

    /// The value of any other setting, as a flag would have it.
    pub fn value(&self) -> Result<String, &'static str> {
        text(&self.value).ok_or("this setting is one text in quotation marks, or one number")
    }
}

fn text(value: &Value) -> Option<String> {
    match value {
        Value::String(text) => Some(text.clone()),
        Value::Integer(number) => Some(number.to_string()),
        Value::Float(number) => Some(number.to_string()),
        _ => None,
    }
}
