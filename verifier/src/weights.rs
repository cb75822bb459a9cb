//! Expert weights as they travel: a safetensors file, read strictly.
//!
//! The file must hold exactly the expected tensors, in float32, and every value must be finite. Otherwise the error names the
//! tensor and says what is wrong with it. Nothing is allocated before the header is checked against the size of the file.

use std::collections::BTreeMap;
use zk0_circuits::model::layout::TensorSpec;
use zk0_protocol::quote::short;
use zk0_tensors::{write_to, Entry, TensorData, TensorError, TensorFile, TensorSet};

/// Largest header of a safetensors file that is read, in bytes. That of the full-size expert has about 20 KB.
pub const MAX_HEADER_BYTES: u64 = 1 << 20;

/// Named float32 tensors, all finite, ordered by name.
#[derive(Clone, Debug, PartialEq)]
pub struct ExpertTensors(TensorSet);

/// Why a file does not hold expert weights. These texts go on the ledger as reasons of refusals, and auditors compare them: to
/// change one is to disagree with the ledgers that have it.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum WeightsError {
    /// The file, or an expected tensor in it, cannot be used.
    #[error("{}", named(.0.clone()))]
    Tensor(#[from] TensorError),
    /// The file holds a tensor that is not expected.
    #[error("tensor '{0}' does not belong to the action expert")]
    Extra(String),
}

/// Says what is wrong. What a stranger's header makes the library say is cut short.
pub(crate) fn named(error: TensorError) -> String {
    match error {
        TensorError::Header(why) => TensorError::Header(short(&why)).to_string(),
        other => other.to_string(),
    }
}

impl ExpertTensors {
    /// Reads a safetensors file that must hold exactly the `expected` tensors.
    pub fn read(bytes: &[u8], expected: &[TensorSpec]) -> Result<Self, WeightsError> {
        let file = TensorFile::open(bytes, MAX_HEADER_BYTES)?;
        let mut tensors = TensorSet::new();
        for TensorSpec { name, shape } in expected {
            let tensor = file.read_f32(name, shape)?.finite(name)?;
            tensors.insert(name.clone(), tensor);
        }
        let mut names = file.names().into_iter();
        match names.find(|name| !tensors.contains_key(name)) {
            Some(name) => Err(WeightsError::Extra(short(&name))),
            None => Ok(Self(tensors)),
        }
    }

    /// The values of a tensor, row-major.
    pub fn get(&self, name: &str) -> Option<&[f32]> {
        self.0.get(name).map(|tensor| tensor.data.as_slice())
    }

    /// Name, shape and values of every tensor, ordered by name.
    pub fn iter(&self) -> impl Iterator<Item = (&str, &[usize], &[f32])> {
        self.0
            .iter()
            .map(|(name, tensor)| (name.as_str(), &tensor.shape[..], &tensor.data[..]))
    }

    /// The same tensors with other values: `values(name)` must give as many as there were, all finite.
    pub fn map(
        &self,
        mut values: impl FnMut(&str, &[f32]) -> Vec<f32>,
    ) -> Result<Self, WeightsError> {
        let tensors = self.0.iter().map(|(name, old)| {
            let new = TensorData {
                shape: old.shape.clone(),
                data: values(name, &old.data),
            };
            if new.data.len() != old.data.len() {
                return Err(TensorError::Shape {
                    name: name.clone(),
                    found: vec![new.data.len()],
                    expected: old.shape.clone(),
                });
            }
            Ok((name.clone(), new.finite(name)?))
        });
        Ok(Self(tensors.collect::<Result<_, _>>()?))
    }

    /// The canonical file: tensors ordered by name, no metadata. Equal tensors give equal bytes on every machine.
    pub fn to_bytes(&self) -> Vec<u8> {
        let mut bytes = Vec::new();
        // Writing to memory fails only on a header beyond the format's limit, and `read` accepts far smaller ones only.
        let _ = write_to(
            &mut bytes,
            self.0.iter().map(Entry::of).collect(),
            BTreeMap::new(),
        );
        bytes
    }
}
