//! A safetensors file, written piece by piece: a checkpoint of the published size is 1.2 GB and a policy 1.8 GB, which are not
//! to be in memory twice.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::Path;

use safetensors::tensor::{Dtype, SafeTensors};
use serde::Serialize;
use sha2::{Digest, Sha256};

/// One tensor of a file.
pub struct Entry<'a> {
    /// Its name.
    pub name: String,
    /// Its shape.
    pub shape: Vec<usize>,
    /// As many values as the shape says, row-major.
    pub values: Cow<'a, [f32]>,
}

/// An entry of the header; fields in the order in which the safetensors crate writes them.
#[derive(Serialize)]
#[serde(untagged)]
enum About<'a> {
    Note(BTreeMap<&'a str, &'a str>),
    Tensor {
        dtype: &'static str,
        shape: &'a [usize],
        data_offsets: [usize; 2],
    },
}

/// What was written.
pub struct Written {
    /// SHA-256 of the file.
    pub digest: [u8; 32],
    /// Its size.
    pub bytes: u64,
}

/// Writes `entries` to `path` and waits until they are on disk; `note` is a key and a text of the file's metadata. Equal
/// tensors give equal bytes.
pub fn write(
    path: &Path,
    mut entries: Vec<Entry>,
    note: Option<(&str, &str)>,
) -> io::Result<Written> {
    entries.sort_by(|a, b| a.name.cmp(&b.name));
    let mut header = BTreeMap::new();
    if let Some(note) = note {
        header.insert("__metadata__", About::Note(BTreeMap::from([note])));
    }
    let mut end = 0;
    for entry in &entries {
        let start = end;
        end += 4 * entry.values.len();
        let about = About::Tensor {
            dtype: "F32",
            shape: &entry.shape,
            data_offsets: [start, end],
        };
        header.insert(entry.name.as_str(), about);
    }
    let mut header = serde_json::to_vec(&header)?;
    header.resize(header.len().next_multiple_of(8), b' ');

    let mut out = Hashing {
        inner: BufWriter::with_capacity(1 << 20, File::create(path)?),
        hash: Sha256::new(),
        bytes: 0,
    };
    out.write_all(&(header.len() as u64).to_le_bytes())?;
    out.write_all(&header)?;
    for entry in &entries {
        for values in entry.values.chunks(1 << 16) {
            let bytes: Vec<u8> = values.iter().flat_map(|x| x.to_le_bytes()).collect();
            out.write_all(&bytes)?;
        }
    }
    let file = out
        .inner
        .into_inner()
        .map_err(io::IntoInnerError::into_error)?;
    file.sync_all()?;
    Ok(Written {
        digest: out.hash.finalize().into(),
        bytes: out.bytes,
    })
}

/// The values of tensor `name` of a file's bytes, or what is wrong with it.
pub fn read(file: &SafeTensors, name: &str, shape: &[usize]) -> Result<Vec<f32>, String> {
    let view = file
        .tensor(name)
        .map_err(|_| format!("tensor `{name}` is missing"))?;
    if view.dtype() != Dtype::F32 || view.shape() != shape {
        return Err(format!(
            "tensor `{name}` is {:?} {:?}, not F32 {shape:?}",
            view.dtype(),
            view.shape()
        ));
    }
    let numbers = view.data().chunks_exact(4);
    let values: Vec<f32> = numbers
        .map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]]))
        .collect();
    match values.iter().all(|x| x.is_finite()) {
        true => Ok(values),
        false => Err(format!("tensor `{name}` holds a value that is not finite")),
    }
}

struct Hashing<W> {
    inner: W,
    hash: Sha256,
    bytes: u64,
}

impl<W: Write> Write for Hashing<W> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let count = self.inner.write(bytes)?;
        self.hash.update(&bytes[..count]);
        self.bytes += count as u64;
        Ok(count)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.inner.flush()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_written_is_a_safetensors_file() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("some.safetensors");
        let entry = |name: &str, shape: &[usize], values: Vec<f32>| Entry {
            name: name.into(),
            shape: shape.into(),
            values: values.into(),
        };
        let many: Vec<f32> = (0..100_000).map(|i| i as f32).collect();
        let written = write(
            &path,
            vec![
                entry("b", &[2, 2], vec![1.0, 2.0, 3.0, 4.0]),
                entry("a", &[100_000], many.clone()),
            ],
            Some(("key", "text")),
        )
        .unwrap();
        let bytes = std::fs::read(&path).unwrap();
        assert_eq!(written.bytes, bytes.len() as u64);
        assert_eq!(written.digest[..], Sha256::digest(&bytes)[..]);
        let file = SafeTensors::deserialize(&bytes).unwrap();
        assert_eq!(read(&file, "a", &[100_000]).unwrap(), many);
        assert_eq!(read(&file, "b", &[2, 2]).unwrap(), [1.0, 2.0, 3.0, 4.0]);
        assert!(read(&file, "b", &[4]).unwrap_err().contains("[2, 2]"));
        let (_, header) = SafeTensors::read_metadata(&bytes).unwrap();
        assert_eq!(header.metadata().as_ref().unwrap()["key"], "text");
        assert!(read(&file, "c", &[4]).unwrap_err().contains("missing"));
    }
}
