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

use crate::safetensors_file::HEADER_LIMIT;
use crate::weights::TensorData;

/// One tensor of a file.
pub struct Entry<'a> {
    /// Its name.
    pub name: String,
    /// Its shape.
    pub shape: Vec<usize>,
    /// As many values as the shape says, row-major.
    pub values: Cow<'a, [f32]>,
}

impl<'a> Entry<'a> {
    /// A tensor that stays where it is.
    pub fn of((name, tensor): (&String, &'a TensorData)) -> Self {
        Self {
            name: name.clone(),
            shape: tensor.shape.clone(),
            values: Cow::Borrowed(&tensor.data[..]),
        }
    }
}

/// An entry of the header; fields in the order in which the safetensors crate writes them.
#[derive(Serialize)]
#[serde(untagged)]
enum About<'a> {
    Notes(BTreeMap<&'a str, &'a str>),
    Tensor {
        dtype: &'static str,
        shape: &'a [usize],
        data_offsets: [usize; 2],
    },
}

/// What was written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Written {
    /// SHA-256 of the file.
    pub digest: [u8; 32],
    /// Its size.
    pub bytes: u64,
}

/// Writes `entries` to `path` and waits until they are on disk. Otherwise as [`write_to`].
pub fn write(path: &Path, entries: Vec<Entry>) -> io::Result<Written> {
    let file = File::create(path)?;
    let out = BufWriter::with_capacity(1 << 20, &file);
    let written = write_to(out, entries, BTreeMap::new())?;
    file.sync_all()?;
    Ok(written)
}

/// Writes `entries`, sorted by name, and `notes`, the file's metadata, piece by piece. Equal tensors and notes give equal bytes:
/// those that the safetensors crate writes.
///
/// # Errors
/// Those of `out`, and one when the notes make the header larger than the format allows.
pub fn write_to(
    out: impl Write,
    mut entries: Vec<Entry>,
    notes: BTreeMap<&str, &str>,
) -> io::Result<Written> {
    entries.sort_by(|a, b| a.name.cmp(&b.name));
    let mut header = BTreeMap::new();
    if !notes.is_empty() {
        header.insert("__metadata__", About::Notes(notes));
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
    if header.len() as u64 > HEADER_LIMIT {
        let wrong = format!(
            "the header has {} bytes, safetensors files have {HEADER_LIMIT} at most",
            header.len()
        );
        return Err(io::Error::new(io::ErrorKind::InvalidInput, wrong));
    }

    let mut out = Hashing {
        inner: out,
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
    out.flush()?;
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

    fn entry<'a>(name: &str, shape: &[usize], values: Vec<f32>) -> Entry<'a> {
        Entry {
            name: name.into(),
            shape: shape.into(),
            values: values.into(),
        }
    }

    #[test]
    fn what_is_written_is_a_safetensors_file() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("some.safetensors");
        let many: Vec<f32> = (0..100_000).map(|i| i as f32).collect();
        let entries = || {
            vec![
                entry("b", &[2, 2], vec![1.0, 2.0, 3.0, 4.0]),
                entry("a", &[100_000], many.clone()),
            ]
        };
        let written = write(&path, entries()).unwrap();
        let bytes = std::fs::read(&path).unwrap();
        assert_eq!(written.bytes, bytes.len() as u64);
        assert_eq!(written.digest[..], Sha256::digest(&bytes)[..]);
        let file = SafeTensors::deserialize(&bytes).unwrap();
        assert_eq!(read(&file, "a", &[100_000]).unwrap(), many);
        assert_eq!(read(&file, "b", &[2, 2]).unwrap(), [1.0, 2.0, 3.0, 4.0]);
        assert!(read(&file, "b", &[4]).unwrap_err().contains("[2, 2]"));
        assert!(read(&file, "c", &[4]).unwrap_err().contains("missing"));

        let mut noted = Vec::new();
        let notes = BTreeMap::from([("key", "text"), ("another", "\"quoted\"\n")]);
        let written = write_to(&mut noted, entries(), notes).unwrap();
        assert_eq!(written.bytes, noted.len() as u64);
        assert_eq!(written.digest[..], Sha256::digest(&noted)[..]);
        let (_, header) = SafeTensors::read_metadata(&noted).unwrap();
        let metadata = header.metadata().as_ref().unwrap();
        assert_eq!(metadata["key"], "text");
        assert_eq!(metadata["another"], "\"quoted\"\n");
    }

    /// Files are named by their digests, on ledgers too: their bytes never change.
    #[test]
    fn the_bytes_are_those_of_the_safetensors_crate() {
        let raw: Vec<u8> = [0.5f32, -3.0]
            .iter()
            .flat_map(|x| x.to_le_bytes())
            .collect();
        for note in [None, Some(("key", "text"))] {
            let views = ["b", "a"].map(|name| {
                let view = safetensors::tensor::TensorView::new(Dtype::F32, vec![2, 1], &raw);
                (name, view.unwrap())
            });
            let metadata = note.map(|(key, text): (&str, &str)| {
                std::collections::HashMap::from([(key.to_string(), text.to_string())])
            });
            let theirs = safetensors::tensor::serialize(views, metadata).unwrap();
            let mut ours = Vec::new();
            let entries = ["a", "b"].map(|name| entry(name, &[2, 1], vec![0.5, -3.0]));
            write_to(&mut ours, entries.into(), note.into_iter().collect()).unwrap();
            assert_eq!(ours, theirs);
        }
    }

    #[test]
    fn a_header_that_nobody_could_read_is_not_written() {
        let text = "x".repeat(HEADER_LIMIT as usize);
        let mut out = Vec::new();
        let error = write_to(&mut out, Vec::new(), BTreeMap::from([("key", &text[..])]));
        let error = error.unwrap_err().to_string();
        assert!(error.contains("100000000 at most"), "{error}");
        assert!(out.is_empty());
    }
}
