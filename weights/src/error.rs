//! Why a file does not hold expert weights.

use zk0_circuits::model::weights::WeightsError as BufferError;
use zk0_protocol::quote::short;
use zk0_tensors::TensorError;

/// Why a file does not hold expert weights. These texts go on the ledger as reasons of refusals, and auditors compare them: to
/// change one is to disagree with the ledgers that have it.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum WeightFileError {
    /// The file, or an expected tensor in it, cannot be used.
    #[error("{}", quoted(.0))]
    Tensor(#[from] TensorError),
    /// The file holds a tensor that is not expected.
    #[error("tensor '{0}' does not belong to the action expert")]
    Extra(String),
    /// The header describes the right tensors in a way that no file of weights does.
    #[error("the safetensors header is not the one that every file of these weights has: it has metadata, another order of the tensors, or another spelling")]
    OtherHeader,
    /// A scale is out of the bounds that the evaluation's specification sets.
    #[error("tensor '{name}' has {bits} fraction bits; it must have {least} to {most}")]
    Scale {
        /// The tensor.
        name: String,
        /// Its fraction bits.
        bits: i16,
        /// The least that it may have.
        least: i16,
        /// The most.
        most: i16,
    },
    /// A scale is not the one that these numbers have.
    #[error("tensor '{name}' has {bits} fraction bits, but its largest magnitude is {largest}, so that it fits with more of them; every tensor has as many as it can")]
    CoarseScale {
        /// The tensor.
        name: String,
        /// Its fraction bits.
        bits: i16,
        /// Its largest magnitude.
        largest: u16,
    },
    /// A value is the one int16 that no weight has.
    #[error("tensor '{name}' holds -32768 at element {index}; magnitudes go up to 32767")]
    TooLarge {
        /// The tensor.
        name: String,
        /// The element, in row-major order.
        index: usize,
    },
    /// The numbers do not make up the weights of a network.
    #[error(transparent)]
    Buffer(#[from] BufferError),
}

/// Says what is wrong. What a stranger's header makes the library say is cut short.
fn quoted(error: &TensorError) -> String {
    match error {
        TensorError::Header(why) => TensorError::Header(short(why)).to_string(),
        other => other.to_string(),
    }
}
