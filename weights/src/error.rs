//! Why a file is refused.

use zk0_circuits::model::weights::WeightsError as BufferError;
use zk0_tensors::TensorError;

/// Why a file is refused. The ledger records these texts, and auditors compare them: never change one.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum WeightFileError {
    /// The file or an expected tensor cannot be used.
    #[error("{}", quoted(.0))]
    Tensor(#[from] TensorError),
    /// An unexpected tensor.
    #[error("tensor '{0}' does not belong to the action expert")]
    Extra(String),
    /// The header is not canonical.
    #[error("the safetensors header is not the one that every file of these weights has: it has metadata, another order of the tensors, or another spelling")]
    OtherHeader,
    /// A scale outside the specification's bounds.
    #[error("tensor '{name}' has {bits} fraction bits; it must have {least} to {most}")]
    Scale {
        /// The tensor.
        name: String,
        /// Its fraction bits.
        bits: i16,
        /// The least.
        least: i16,
        /// The most.
        most: i16,
    },
    /// The numbers have another scale.
    #[error("tensor '{name}' has {bits} fraction bits, but its largest magnitude is {largest}, so that it fits with more of them; every tensor has as many as it can")]
    CoarseScale {
        /// The tensor.
        name: String,
        /// Its fraction bits.
        bits: i16,
        /// Its largest magnitude.
        largest: u16,
    },
    /// A value is −32768.
    #[error("tensor '{name}' holds -32768 at element {index}; magnitudes go up to 32767")]
    TooLarge {
        /// The tensor.
        name: String,
        /// The element, in row-major order.
        index: usize,
    },
    /// The numbers do not make up weights.
    #[error(transparent)]
    Buffer(#[from] BufferError),
}

/// The most characters quoted of a stranger's text.
const MAX_QUOTED: usize = 128;

/// Shortens a stranger's text and escapes every character that could control a terminal.
pub(crate) fn short(text: &str) -> String {
    text.chars()
        .take(MAX_QUOTED)
        .flat_map(char::escape_debug)
        .collect()
}

fn quoted(error: &TensorError) -> String {
    match error {
        TensorError::Header(why) => TensorError::Header(short(why)).to_string(),
        other => other.to_string(),
    }
}
