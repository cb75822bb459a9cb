//! Writes a safetensors file piece by piece: a policy of the published size (1.8 GB) must not be in memory twice.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::io::{self, Write};

use safetensors::tensor::Dtype;
use sha2::{Digest, Sha256};

use crate::header::TensorHeader;
use crate::tensor_data::TensorData;

/// One tensor of a file.
pub struct TensorEntry<'a> {
    /// Its name.
    pub name: String,
    /// Its shape.
    pub shape: Vec<usize>,
    /// Its values, row-major.
    pub values: Cow<'a, [f32]>,
}

impl<'a> TensorEntry<'a> {
    /// Borrows a tensor.
    pub fn of((name, tensor): (&String, &'a TensorData)) -> Self {
        Self {
            name: name.clone(),
            shape: tensor.shape.clone(),
            values: Cow::Borrowed(&tensor.data[..]),
        }
    }
}

/// A written file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct WrittenTensors {
    /// The file's SHA-256.
    pub digest: [u8; 32],
    /// Its size.
    pub bytes: u64,
}

/// Writes `entries`, sorted by name, and the metadata `notes`. Equal input gives equal bytes: those of the safetensors crate.
///
/// # Errors
/// Those of `out`, or the header is larger than the format allows.
pub fn write_to(
    out: impl Write,
    mut entries: Vec<TensorEntry>,
    notes: BTreeMap<&str, &str>,
) -> io::Result<WrittenTensors> {
    entries.sort_by(|a, b| a.name.cmp(&b.name));
    let tensors = entries.iter();
    let tensors = tensors.map(|entry| (entry.name.clone(), Dtype::F32, entry.shape.clone()));
    let header = TensorHeader::new((!notes.is_empty()).then_some(notes), tensors).to_bytes()?;

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
    Ok(WrittenTensors {
        digest: out.hash.finalize().into(),
        bytes: out.bytes,
    })
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
    use crate::header::HEADER_LIMIT;
    use crate::tensor_file::TensorFile;

    fn entry<'a>(name: &str, shape: &[usize], values: Vec<f32>) -> TensorEntry<'a> {
        TensorEntry {
            name: name.into(),
            shape: shape.into(),
            values: values.into(),
        }
    }

    #[test]
    fn what_is_written_is_a_safetensors_file() {
        let many: Vec<f32> = (0..100_000).map(|i| i as f32).collect();
        let entries = || {
            vec![
                entry("b", &[2, 2], vec![1.0, 2.0, 3.0, 4.0]),
                entry("a", &[100_000], many.clone()),
            ]
        };
        let mut bytes = Vec::new();
        let written = write_to(&mut bytes, entries(), BTreeMap::new()).unwrap();
        assert_eq!(written.bytes, bytes.len() as u64);
        assert_eq!(written.digest[..], Sha256::digest(&bytes)[..]);
        let read = |bytes| TensorFile::open(bytes, HEADER_LIMIT).unwrap();
        let file = read(&bytes[..]);
        assert_eq!(file.read_f32("a", &[100_000]).unwrap().data, many);
        let small = file.read_f32("b", &[2, 2]).unwrap();
        assert_eq!(small.data, [1.0, 2.0, 3.0, 4.0]);
        let error = |name, shape: &[usize]| file.read_f32(name, shape).unwrap_err().to_string();
        assert!(error("b", &[4]).contains("[2, 2]"));
        assert!(error("c", &[4]).contains("missing"));

        let mut noted = Vec::new();
        let notes = BTreeMap::from([("key", "text"), ("another", "\"quoted\"\n")]);
        let written = write_to(&mut noted, entries(), notes).unwrap();
        assert_eq!(written.bytes, noted.len() as u64);
        assert_eq!(written.digest[..], Sha256::digest(&noted)[..]);
        let metadata = read(&noted[..]).metadata().clone().unwrap();
        assert_eq!(metadata["key"], "text");
        assert_eq!(metadata["another"], "\"quoted\"\n");
    }

    /// Ledgers name files by digests, so the bytes never change.
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
