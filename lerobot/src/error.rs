//! What can be wrong with a stored policy: configuration, tensors, tokenizer.

use std::path::{Path, PathBuf};

use zk0_tensors::TensorError;

use crate::lfs_pointer;

/// Why a policy's files cannot be read or written.
#[derive(Debug, thiserror::Error)]
pub enum StoredPolicyError {
    /// A configuration is bad JSON, or needs something that is not implemented.
    #[error("policy configuration: {0}")]
    Config(String),
    /// A weights file, or a tensor in it, is unusable.
    #[error("weights: {0}; the file is damaged or belongs to another model or profile: fetch or write it again")]
    Tensor(#[from] TensorError),
    /// A file or folder cannot be read or written, or has wrong content.
    #[error("{}: {cause}", .path.display())]
    AtPath {
        /// The file or folder.
        path: PathBuf,
        /// The fault and the remedy.
        cause: String,
    },
    /// A policy file's tokenizer is unusable, or another policy's.
    #[error("the policy file's tokenizer {0}")]
    Tokenizer(String),
    /// A number is too large for the type to write.
    #[error("tensor `{name}` holds a number too large for {dtype}; write it in F32")]
    TooLarge {
        /// LeRobot's name of the tensor.
        name: String,
        /// The type.
        dtype: String,
    },
    /// The statistics to write do not fit the policy.
    #[error("statistics of `{feature}` have {found} dimensions, the policy has {expected}")]
    Statistics {
        /// LeRobot's name of the feature.
        feature: &'static str,
        /// The policy's dimensions.
        expected: usize,
        /// The statistics' dimensions.
        found: usize,
    },
}

/// Result of reading or writing a policy's files.
pub type Result<T> = std::result::Result<T, StoredPolicyError>;

impl StoredPolicyError {
    /// An error about the file or folder `path`. Names a file that Git LFS has not fetched.
    pub fn file(path: &Path, cause: impl std::fmt::Display) -> Self {
        Self::AtPath {
            path: path.to_path_buf(),
            cause: lfs_pointer::explain(path).unwrap_or_else(|| cause.to_string()),
        }
    }

    /// Adds the path of the wrong file, unless the error names one.
    pub fn within(self, path: &Path) -> Self {
        match self {
            Self::AtPath { .. } => self,
            other => Self::file(path, other),
        }
    }
}
