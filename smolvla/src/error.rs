//! Errors of policies, samples and training.

use zk0_lerobot::dataset::DatasetError;
use zk0_lerobot::StoredPolicyError;
use zk0_tensors::TensorError;

/// Why a policy cannot be read, run or trained.
#[derive(Debug, thiserror::Error)]
pub enum PolicyError {
    /// A policy's configuration, tensors, tokenizer or file.
    #[error(transparent)]
    Stored(#[from] StoredPolicyError),
    /// A frame or sample does not fit the policy.
    #[error("sample: {0}")]
    Sample(String),
    /// A recording's frame cannot be read.
    #[error("frame {frame} of recording {recording}: {error}")]
    Recording {
        /// The frame.
        frame: usize,
        /// The recording, counted from 0.
        recording: usize,
        /// The file's error.
        error: Box<DatasetError>,
    },
    /// Contradictory or unusable options.
    #[error("training options: {0}")]
    Options(String),
    /// The loss does not reach a trainable tensor.
    #[error("training: tensor `{0}` has no gradient; an operation between it and the loss lacks a backward pass")]
    NoGradient(String),
    /// The loss became NaN or infinite: the weights are useless.
    #[error(
        "training diverged: the loss is {loss} at step {step} of {of}; lower the learning rate"
    )]
    Diverged {
        /// The step, from 1.
        step: usize,
        /// All steps.
        of: usize,
        /// The loss.
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

impl PolicyError {
    /// Whether training is at fault: other weights may train well.
    pub fn is_of_training(&self) -> bool {
        matches!(
            self,
            Self::Diverged { .. }
                | Self::GradientNotFinite { .. }
                | Self::Stored(StoredPolicyError::Tensor(TensorError::NotFinite { .. }))
        )
    }
}

impl From<TensorError> for PolicyError {
    fn from(error: TensorError) -> Self {
        Self::Stored(error.into())
    }
}

/// Result of policy functions.
pub type Result<T> = std::result::Result<T, PolicyError>;
