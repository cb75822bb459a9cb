//! What can be wrong with a stored policy: its configuration, its tensors, its tokenizer.

use std::path::{Path, PathBuf};

/// Why the files of a policy cannot be read or written.
#[derive(Debug, thiserror::Error)]
pub enum StoredPolicyError {
    /// A configuration is not JSON of the expected form, or it asks for something that is not implemented.
    #[error("policy configuration: {0}")]
    Config(String),
    /// A file of weights is cut short, or it is not a safetensors file.
    #[error("weights: not a complete safetensors file ({0}); fetch or write it again")]
    Safetensors(String),
    /// A tensor that the policy needs is not in the file.
    #[error("weights: tensor `{0}` is missing")]
    MissingTensor(String),
    /// A tensor in the file does not belong to this policy.
    #[error("weights: unexpected tensor `{0}`; the file belongs to another model or profile")]
    UnexpectedTensor(String),
    /// A tensor has other dimensions than the configuration gives it.
    #[error("weights: tensor `{name}` has shape {found:?}, the configuration needs {expected:?}")]
    Shape {
        /// LeRobot's name of the tensor.
        name: String,
        /// The shape that follows from the configuration.
        expected: Vec<usize>,
        /// The shape in the file.
        found: Vec<usize>,
    },
    /// A tensor is stored in a number format that is not read.
    #[error("weights: tensor `{name}` has type {found}, only {accepted} is accepted")]
    Dtype {
        /// LeRobot's name of the tensor.
        name: String,
        /// The type in the file.
        found: String,
        /// The types that are read.
        accepted: &'static str,
    },
    /// A tensor holds NaN or an infinity.
    #[error("weights: tensor `{name}` holds {value} at element {index}; do not use this file")]
    NotFinite {
        /// LeRobot's name of the tensor.
        name: String,
        /// Offset of the first such element, row-major.
        index: usize,
        /// Its value.
        value: f32,
    },
    /// A file or folder cannot be read or written, or its content is wrong.
    #[error("{}: {cause}", .path.display())]
    AtPath {
        /// Which file or folder.
        path: PathBuf,
        /// What is wrong, and what to do.
        cause: String,
    },
    /// The tokenizer inside a policy file cannot be used, or it belongs to another policy.
    #[error("the policy file's tokenizer {0}")]
    Tokenizer(String),
    /// A number is too large for the type that it is to be written in.
    #[error("tensor `{name}` holds a number too large for {dtype}; write it in F32")]
    TooLarge {
        /// LeRobot's name of the tensor.
        name: String,
        /// The type.
        dtype: String,
    },
    /// The statistics to be written do not fit the policy.
    #[error("statistics of `{feature}` have {found} dimensions, the policy has {expected}")]
    Statistics {
        /// LeRobot's name of the feature.
        feature: &'static str,
        /// Dimensions of the policy.
        expected: usize,
        /// Dimensions of the statistics.
        found: usize,
    },
}

/// Result of everything that reads or writes a policy's files.
pub type Result<T> = std::result::Result<T, StoredPolicyError>;

impl StoredPolicyError {
    /// An error about the file or folder `path`.
    pub fn file(path: &Path, cause: impl std::fmt::Display) -> Self {
        Self::AtPath {
            path: path.to_path_buf(),
            cause: cause.to_string(),
        }
    }

    /// Adds the path of the file whose content is wrong, unless the error already names one.
    pub fn within(self, path: &Path) -> Self {
        match self {
            Self::AtPath { .. } => self,
            other => Self::file(path, other),
        }
    }
}
