//! Errors of safetensors files and their tensors.

use std::io;

/// Why a safetensors file or its tensor cannot be used.
///
/// Ledgers hold these texts as reasons of refusals, and auditors compare them: a changed text disagrees with existing ledgers.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum TensorError {
    /// The file has no room for a header.
    #[error("truncated: {0} bytes are too few for a safetensors file")]
    NoHeader(u64),
    /// The header is larger than the limit.
    #[error("the safetensors header states it has {bytes} bytes, more than the {limit} allowed")]
    HeaderTooLarge { bytes: u64, limit: u64 },
    /// The header is longer than the file.
    #[error("truncated: the safetensors header has {header} bytes, only {left} follow")]
    HeaderTruncated { header: u64, left: u64 },
    /// The header is not a safetensors header, or contradicts itself. The text may quote the file at any length.
    #[error("bad safetensors header: {0}")]
    Header(String),
    /// The file is shorter or longer than its header states.
    #[error("the safetensors header describes more or fewer bytes than the file's {0}: truncated, or followed by other bytes")]
    Length(u64),
    /// An expected tensor is missing.
    #[error("tensor '{0}' is missing")]
    Missing(String),
    /// A tensor is not expected.
    #[error("tensor '{0}' is not expected")]
    Unexpected(String),
    /// A tensor's type is not accepted.
    #[error("tensor '{name}' is {found}, expected {accepted}")]
    Dtype {
        name: String,
        found: String,
        accepted: String,
    },
    /// A tensor has another shape.
    #[error("tensor '{name}' has shape {found:?}, expected {expected:?}")]
    Shape {
        name: String,
        found: Vec<usize>,
        expected: Vec<usize>,
    },
    /// The first NaN or infinite value, by its place in row-major order; as text, because NaN does not equal itself.
    #[error("tensor '{name}' holds {value} at element {index}")]
    NotFinite {
        name: String,
        index: usize,
        value: String,
    },
    /// The operating system cannot read the file.
    #[error("{0}")]
    Io(String),
}

/// Result of reading tensors.
pub type Result<T> = std::result::Result<T, TensorError>;

impl From<io::Error> for TensorError {
    fn from(error: io::Error) -> Self {
        Self::Io(error.to_string())
    }
}
