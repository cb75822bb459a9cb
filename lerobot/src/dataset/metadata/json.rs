//! Metadata in JSON: one document, or one per line. Files above a limit are refused unread.

use std::fs::File;
use std::io::{BufRead, BufReader, Error, ErrorKind, Read};
use std::path::Path;

use serde::de::{DeserializeOwned, Error as _};
use serde::{Deserialize, Deserializer};
use serde_json::Value;
use zk0_files::bounded_file;

use crate::dataset::DatasetError;

/// Largest JSON file read, in bytes.
const MAX_FILE: u64 = 16 << 20;
/// Longest line read of a `.jsonl` file, in bytes.
const MAX_LINE: u64 = 1 << 20;

pub(crate) fn read_text(path: &Path) -> Result<String, DatasetError> {
    let bytes = bounded_file::read(path, MAX_FILE).map_err(|e| match e.kind() {
        ErrorKind::FileTooLarge => {
            DatasetError::meta(path, format!("is larger than {MAX_FILE} bytes"))
        }
        _ => DatasetError::io(path, e),
    })?;
    String::from_utf8(bytes)
        .map_err(|e| DatasetError::io(path, Error::new(ErrorKind::InvalidData, e)))
}

/// Parses JSON as Python writes it: its `NaN`, `Infinity` and `-Infinity` become `null`.
pub(crate) fn parse<T: DeserializeOwned>(text: &str) -> serde_json::Result<T> {
    let strict = serde_json::from_str(text);
    match strict {
        Err(_) if text.contains("NaN") || text.contains("Infinity") => {
            serde_json::from_str(&without_python_numbers(text))
        }
        parsed => parsed,
    }
}

/// Leaves JSON strings as they are.
fn without_python_numbers(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    let mut rest = text;
    let (mut in_string, mut escaped) = (false, false);
    while let Some(c) = rest.chars().next() {
        let number = ["NaN", "Infinity", "-Infinity"]
            .into_iter()
            .find(|name| !in_string && rest.starts_with(name));
        if let Some(name) = number {
            out.push_str("null");
            rest = &rest[name.len()..];
            continue;
        }
        if c == '"' && !escaped {
            in_string = !in_string;
        }
        escaped = in_string && c == '\\' && !escaped;
        out.push(c);
        rest = &rest[c.len_utf8()..];
    }
    out
}

/// A whole number, even as Python's float `30.0`.
pub(crate) fn whole_number<'de, D: Deserializer<'de>, T: TryFrom<u64>>(
    deserializer: D,
) -> Result<T, D::Error> {
    let value = serde_json::Number::deserialize(deserializer)?;
    let float = value
        .as_f64()
        .filter(|v| v.fract() == 0.0 && (0.0..=EXACT).contains(v));
    value
        .as_u64()
        .or(float.map(|v| v as u64))
        .and_then(|v| T::try_from(v).ok())
        .ok_or_else(|| D::Error::custom(format!("{value} where a whole number is expected")))
}

pub(crate) fn whole_number_or_none<'de, D: Deserializer<'de>, T: TryFrom<u64>>(
    deserializer: D,
) -> Result<Option<T>, D::Error> {
    Ok(Option::<Whole<T>>::deserialize(deserializer)?.map(|whole| whole.0))
}

pub(crate) fn whole_numbers<'de, D: Deserializer<'de>, T: TryFrom<u64>>(
    deserializer: D,
) -> Result<Vec<T>, D::Error> {
    let whole = Vec::<Whole<T>>::deserialize(deserializer)?;
    Ok(whole.into_iter().map(|whole| whole.0).collect())
}

struct Whole<T>(T);

impl<'de, T: TryFrom<u64>> Deserialize<'de> for Whole<T> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        whole_number(deserializer).map(Self)
    }
}

/// Numbers, with `null` for Python's `NaN` and infinities. As in numpy, nested lists and a single number count as a list.
pub(crate) fn numbers<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Vec<f64>, D::Error> {
    fn collect(value: &Value, into: &mut Vec<f64>) -> Result<(), String> {
        match value {
            Value::Array(values) => values.iter().try_for_each(|value| collect(value, into))?,
            Value::Null => into.push(f64::NAN),
            other => match other.as_f64() {
                Some(number) => into.push(number),
                None => return Err("found something else where numbers are expected".into()),
            },
        }
        Ok(())
    }
    let mut numbers = Vec::new();
    collect(&Value::deserialize(deserializer)?, &mut numbers).map_err(D::Error::custom)?;
    Ok(numbers)
}

/// From here on, floats skip whole numbers.
const EXACT: f64 = (1u64 << 53) as f64;

/// Gives each line's object of a `.jsonl` file to `each`, with the line number from 1; skips empty lines.
pub(crate) fn read_lines<T: DeserializeOwned>(
    path: &Path,
    mut each: impl FnMut(usize, T) -> Result<(), DatasetError>,
) -> Result<(), DatasetError> {
    let mut reader = BufReader::new(File::open(path).map_err(|e| DatasetError::io(path, e))?);
    let mut line = Vec::new();
    for number in 1.. {
        line.clear();
        let read = (&mut reader)
            .take(MAX_LINE + 1)
            .read_until(b'\n', &mut line)
            .map_err(|e| DatasetError::io(path, e))?;
        if read == 0 {
            break;
        }
        let wrong = |cause: String| DatasetError::meta(path, format!("line {number} {cause}"));
        if line.len() as u64 > MAX_LINE {
            return Err(wrong(format!("is longer than {MAX_LINE} bytes")));
        }
        if line.iter().all(u8::is_ascii_whitespace) {
            continue;
        }
        let text = std::str::from_utf8(&line).map_err(|e| wrong(format!("is not UTF-8: {e}")))?;
        let value = parse(text).map_err(|e| wrong(format!("is not the JSON it should be: {e}")))?;
        each(number, value)?;
    }
    Ok(())
}
