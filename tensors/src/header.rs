//! The header of a file to write.

use std::collections::BTreeMap;
use std::io;

use safetensors::tensor::{Dtype, TensorInfo};
use serde::ser::{Serialize, SerializeMap, Serializer};

/// The format's limit for a header, in bytes.
pub const HEADER_LIMIT: u64 = 100_000_000;

/// A file's metadata, and the type, shape and place of each tensor.
pub struct TensorHeader<'a> {
    metadata: Option<BTreeMap<&'a str, &'a str>>,
    tensors: Vec<(String, TensorInfo)>,
}

impl<'a> TensorHeader<'a> {
    /// A header for tensors in this order.
    pub fn new(
        metadata: Option<BTreeMap<&'a str, &'a str>>,
        tensors: impl IntoIterator<Item = (String, Dtype, Vec<usize>)>,
    ) -> Self {
        let mut start = 0;
        let tensors = tensors.into_iter().map(|(name, dtype, shape)| {
            let end = start + shape.iter().product::<usize>() * dtype.bitsize() / 8;
            let info = TensorInfo {
                dtype,
                shape,
                data_offsets: (start, end),
            };
            start = end;
            (name, info)
        });
        let tensors = tensors.collect();
        Self { metadata, tensors }
    }

    /// The tensors, in the order of their data.
    pub fn tensors(&self) -> impl Iterator<Item = (&str, &TensorInfo)> {
        self.tensors.iter().map(|(name, info)| (&name[..], info))
    }

    /// The header without its length: JSON, filled up with spaces to a multiple of 8 bytes.
    ///
    /// # Errors
    /// The header is larger than the format allows.
    pub fn to_bytes(&self) -> io::Result<Vec<u8>> {
        let mut bytes = serde_json::to_vec(self)?;
        bytes.resize(bytes.len().next_multiple_of(8), b' ');
        if bytes.len() as u64 > HEADER_LIMIT {
            let wrong = format!(
                "the header has {} bytes, safetensors files have {HEADER_LIMIT} at most",
                bytes.len()
            );
            return Err(io::Error::new(io::ErrorKind::InvalidInput, wrong));
        }
        Ok(bytes)
    }
}

impl Serialize for TensorHeader<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> std::result::Result<S::Ok, S::Error> {
        let mut map = serializer.serialize_map(None)?;
        if let Some(metadata) = &self.metadata {
            map.serialize_entry("__metadata__", metadata)?;
        }
        for (name, info) in &self.tensors {
            map.serialize_entry(name, info)?;
        }
        map.end()
    }
}
