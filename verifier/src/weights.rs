//! Expert weights as they travel: a safetensors file, read strictly.
//!
//! The file must hold exactly the expected tensors, in float32, and every value must be finite. Otherwise the error names the
//! tensor and says what is wrong with it. Nothing is allocated before the header is checked against the size of the file.

use safetensors::tensor::SafeTensorError;
use safetensors::{Dtype, SafeTensors, View};
use sha2::{Digest as _, Sha256};
use std::borrow::Cow;
use std::collections::BTreeMap;
use zk0_circuits::model::layout::TensorSpec;
use zk0_circuits::Digest;
use zk0_protocol::quote::short;

/// Largest header of a safetensors file that is read, in bytes. That of the full-size expert has about 20 KB.
pub const MAX_HEADER_BYTES: u64 = 1 << 20;

/// Named float32 tensors, all finite, ordered by name.
#[derive(Clone, Debug, PartialEq)]
pub struct ExpertTensors(BTreeMap<String, Tensor>);

#[derive(Clone, Debug, PartialEq)]
struct Tensor {
    shape: Vec<usize>,
    values: Vec<f32>,
}

/// Why a file does not hold expert weights. These texts go on the ledger as reasons of refusals, and auditors compare them: to
/// change one is to disagree with the ledgers that have it.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum WeightsError {
    /// The file has no room for a header.
    #[error("truncated: {0} bytes are too few for a safetensors file")]
    NoHeader(u64),
    /// The header is larger than the limit.
    #[error(
        "the safetensors header says it has {0} bytes, more than the {MAX_HEADER_BYTES} allowed"
    )]
    HeaderTooLarge(u64),
    /// The header goes on past the end of the file.
    #[error("truncated: the safetensors header has {header} bytes, only {left} follow")]
    HeaderTruncated { header: u64, left: u64 },
    /// The header is not a safetensors header, or it contradicts itself.
    #[error("bad safetensors header: {0}")]
    Header(String),
    /// The file is shorter or longer than its header says.
    #[error("the safetensors header describes more or fewer bytes than the file's {0}: truncated, or followed by other bytes")]
    Length(u64),
    /// An expected tensor is missing.
    #[error("tensor '{0}' is missing")]
    Missing(String),
    /// The file holds a tensor that is not expected.
    #[error("tensor '{0}' does not belong to the action expert")]
    Extra(String),
    /// A tensor has another type than float32.
    #[error("tensor '{tensor}' is {found}, expected F32")]
    Dtype { tensor: String, found: String },
    /// A tensor has another shape.
    #[error("tensor '{tensor}' has shape {found:?}, expected {expected:?}")]
    Shape {
        tensor: String,
        found: Vec<usize>,
        expected: Vec<usize>,
    },
    /// A value is NaN or infinite.
    #[error("tensor '{tensor}' holds {value} at element {index}")]
    NotFinite {
        tensor: String,
        index: usize,
        value: String,
    },
}

impl ExpertTensors {
    /// Reads a safetensors file that must hold exactly the `expected` tensors.
    pub fn read(bytes: &[u8], expected: &[TensorSpec]) -> Result<Self, WeightsError> {
        let start = bytes
            .first_chunk()
            .ok_or(WeightsError::NoHeader(bytes.len() as u64))?;
        check_header(bytes.len() as u64, start)?;
        let file = SafeTensors::deserialize(bytes).map_err(|error| match error {
            SafeTensorError::MetadataIncompleteBuffer => WeightsError::Length(bytes.len() as u64),
            other => WeightsError::Header(short(&other.to_string())),
        })?;
        let mut tensors = BTreeMap::new();
        for TensorSpec { name, shape } in expected {
            let view = file
                .tensor(name)
                .map_err(|_| WeightsError::Missing(name.clone()))?;
            if view.dtype() != Dtype::F32 {
                return Err(WeightsError::Dtype {
                    tensor: name.clone(),
                    found: format!("{:?}", view.dtype()),
                });
            }
            if view.shape() != shape {
                return Err(WeightsError::Shape {
                    tensor: name.clone(),
                    found: view.shape().to_vec(),
                    expected: shape.clone(),
                });
            }
            let values = view
                .data()
                .chunks_exact(4)
                .map(|bytes| f32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]))
                .collect();
            let tensor = Tensor {
                shape: shape.clone(),
                values,
            };
            tensor.check_finite(name)?;
            tensors.insert(name.clone(), tensor);
        }
        match file
            .names()
            .into_iter()
            .find(|name| !tensors.contains_key(*name))
        {
            Some(name) => Err(WeightsError::Extra(short(name))),
            None => Ok(Self(tensors)),
        }
    }

    /// The values of a tensor, row-major.
    pub fn get(&self, name: &str) -> Option<&[f32]> {
        self.0.get(name).map(|tensor| tensor.values.as_slice())
    }

    /// Name, shape and values of every tensor, ordered by name.
    pub fn iter(&self) -> impl Iterator<Item = (&str, &[usize], &[f32])> {
        self.0
            .iter()
            .map(|(name, tensor)| (name.as_str(), &tensor.shape[..], &tensor.values[..]))
    }

    /// The same tensors with other values: `values(name)` must give as many as there were, all finite.
    pub fn map(
        &self,
        mut values: impl FnMut(&str, &[f32]) -> Vec<f32>,
    ) -> Result<Self, WeightsError> {
        let tensors = self.0.iter().map(|(name, old)| {
            let new = Tensor {
                shape: old.shape.clone(),
                values: values(name, &old.values),
            };
            if new.values.len() != old.values.len() {
                return Err(WeightsError::Shape {
                    tensor: name.clone(),
                    found: vec![new.values.len()],
                    expected: old.shape.clone(),
                });
            }
            new.check_finite(name)?;
            Ok((name.clone(), new))
        });
        tensors.collect::<Result<_, _>>().map(Self)
    }

    /// The canonical file: tensors ordered by name, no metadata. Equal tensors give equal bytes on every machine.
    pub fn to_bytes(&self) -> Vec<u8> {
        // Serialising fails only on a shape that contradicts its data, which `read` and `map` rule out.
        safetensors::serialize(&self.0, None).unwrap_or_default()
    }
}

impl Tensor {
    fn check_finite(&self, name: &str) -> Result<(), WeightsError> {
        match self.values.iter().position(|value| !value.is_finite()) {
            Some(index) => Err(WeightsError::NotFinite {
                tensor: name.to_owned(),
                index,
                value: self.values[index].to_string(),
            }),
            None => Ok(()),
        }
    }
}

impl View for &Tensor {
    fn dtype(&self) -> Dtype {
        Dtype::F32
    }

    fn shape(&self) -> &[usize] {
        &self.shape
    }

    fn data(&self) -> Cow<'_, [u8]> {
        let bytes = self.values.iter().flat_map(|value| value.to_le_bytes());
        Cow::Owned(bytes.collect())
    }

    fn data_len(&self) -> usize {
        self.values.len() * 4
    }
}

/// SHA-256 of bytes: how blobs are addressed.
pub fn blob_digest(bytes: &[u8]) -> Digest {
    Digest(Sha256::digest(bytes).into())
}

/// The first eight bytes of a file of `size` bytes are the length of the JSON header that follows, little endian.
pub(crate) fn check_header(size: u64, start: &[u8; 8]) -> Result<u64, WeightsError> {
    let header = u64::from_le_bytes(*start);
    if header > MAX_HEADER_BYTES {
        return Err(WeightsError::HeaderTooLarge(header));
    }
    let left = size.saturating_sub(8);
    if header > left {
        return Err(WeightsError::HeaderTruncated { header, left });
    }
    Ok(header)
}
