//! What can go wrong between a configuration, weights and samples, said for the person who reads it.

use std::path::{Path, PathBuf};

/// Errors of the policy: configuration, weights, samples and training.
#[derive(Debug, thiserror::Error)]
pub enum PolicyError {
    /// A configuration that is not JSON of the expected form, or that this implementation cannot run.
    #[error("policy configuration: {0}")]
    Config(String),
    /// A weights file that is cut short or is not safetensors at all.
    #[error("weights: not a complete safetensors file ({0}); fetch or write it again")]
    Safetensors(String),
    /// A tensor the policy needs is not there.
    #[error("weights: tensor `{0}` is missing")]
    MissingTensor(String),
    /// A tensor that does not belong to this policy.
    #[error("weights: unexpected tensor `{0}`; the file belongs to another model or profile")]
    UnexpectedTensor(String),
    /// A tensor with other dimensions than the configuration gives it.
    #[error("weights: tensor `{name}` has shape {found:?}, the configuration needs {expected:?}")]
    Shape {
        /// LeRobot's name of the tensor.
        name: String,
        /// The shape that follows from the configuration.
        expected: Vec<usize>,
        /// The shape in the file.
        found: Vec<usize>,
    },
    /// A tensor stored in another number format.
    #[error("weights: tensor `{name}` has type {found}, only {accepted} is accepted")]
    Dtype {
        /// LeRobot's name of the tensor.
        name: String,
        /// The type in the file.
        found: String,
        /// What could be read.
        accepted: &'static str,
    },
    /// A tensor holding NaN or an infinity.
    #[error("weights: tensor `{name}` holds {value} at element {index}; refuse this file")]
    NotFinite {
        /// LeRobot's name of the tensor.
        name: String,
        /// Offset of the first offending element, row-major.
        index: usize,
        /// Its value.
        value: f32,
    },
    /// A file or folder of a checkpoint or tokenizer that cannot be read or written, or is not what it should be.
    #[error("{}: {cause}", .path.display())]
    AtPath {
        /// Which file or folder.
        path: PathBuf,
        /// What is wrong, and what to do.
        cause: String,
    },
    /// The tokenizer in a policy file: unusable, or of another policy.
    #[error("the policy file's tokenizer {0}")]
    Tokenizer(String),
    /// A frame or prepared sample that does not fit the policy.
    #[error("sample: {0}")]
    Sample(String),
    /// Training options that make no sense.
    #[error("training options: {0}")]
    Options(String),
    /// A trainable tensor that the loss does not reach.
    #[error("training: tensor `{0}` has no gradient; an operation between it and the loss lacks a backward pass")]
    NoGradient(String),
    /// The loss became NaN or infinite: the weights of that step are useless.
    #[error(
        "training diverged: the loss is {loss} at step {step} of {of}; lower the learning rate"
    )]
    Diverged {
        /// Step at which it happened, from 1.
        step: usize,
        /// Steps asked for.
        of: usize,
        /// The offending loss.
        loss: f32,
    },
    /// A gradient became NaN or infinite; the step was not made.
    #[error("training: the norm of the gradient is {norm}; lower the learning rate")]
    GradientNotFinite {
        /// The norm over all tensors.
        norm: f64,
    },
    /// Tensor arithmetic failed.
    #[error("tensor arithmetic: {0}")]
    Candle(#[from] candle_core::Error),
}

/// Result of the policy's functions.
pub type Result<T> = std::result::Result<T, PolicyError>;

impl PolicyError {
    /// An error of a file, said with its path.
    pub(crate) fn file(path: &Path, cause: impl std::fmt::Display) -> Self {
        Self::AtPath {
            path: path.to_path_buf(),
            cause: cause.to_string(),
        }
    }

    /// Says an error of a file's content with the file's path.
    pub(crate) fn within(self, path: &Path) -> Self {
        match self {
            Self::AtPath { .. } => self,
            other => Self::file(path, other),
        }
    }
}
