//! What can be wrong with a stored policy: its configuration, its tensors, its tokenizer.

use std::path::{Path, PathBuf};

use zk0_tensors::TensorError;

use crate::lfs_pointer;

/// Why the files of a policy cannot be read or written.
#[derive(Debug, thiserror::Error)]
pub enum StoredPolicyError {
    /// A configuration is not JSON of the expected form, or it asks for something that is not implemented.
    #[error("policy configuration: {0}")]
    Config(String),
    /// A file of weights, or a tensor in it, cannot be used.
    #[error("weights: {0}; the file is damaged or belongs to another model or profile: fetch or write it again")]
    Tensor(#[from] TensorError),
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
    /// An error about the file or folder `path`. A file that Git LFS has not fetched is called that, whatever its reader found wrong.
    pub fn file(path: &Path, cause: impl std::fmt::Display) -> Self {
        Self::AtPath {
            path: path.to_path_buf(),
            cause: lfs_pointer::explain(path).unwrap_or_else(|| cause.to_string()),
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
