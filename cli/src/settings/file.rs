//! A TOML file with one key for each setting, and no tables.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use toml::{Spanned, Value};
use zk0_files::bounded_file;

const MAX_FILE_BYTES: u64 = 1 << 20;

/// The file, as errors name it.
#[derive(Default)]
pub(super) struct SettingsFile(PathBuf);

/// One setting in the file.
pub(super) struct FileSetting {
    pub key: String,
    /// Counted from 1.
    pub line: usize,
    value: Value,
}

impl SettingsFile {
    /// Reads the settings in the order of lines. The error states what is wrong, and where.
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
    pub fn reports(&self, setting: &FileSetting, why: &str) -> String {
        let FileSetting { key, line, .. } = setting;
        format!("{}, line {line}: {key}: {why}", self.name())
    }
}

impl FileSetting {
    /// The value of a switch.
    pub fn flag(&self) -> Result<bool, &'static str> {
        let wrong = "this setting is true or false, without quotation marks";
        self.value.as_bool().ok_or(wrong)
    }

    /// The values of a list.
    pub fn list(&self) -> Result<Vec<String>, &'static str> {
        let wrong = "this setting is a list, such as [\"one\", \"other\"]";
        let values = self.value.as_array().ok_or(wrong)?;
        values
            .iter()
            .map(|value| text(value).ok_or(wrong))
            .collect()
    }

    /// Any other value, as a flag has it.
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
