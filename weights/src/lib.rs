//! Expert weights as they travel: int16 tensors and scales, in a safetensors file.
//!
//! Equal weights have exactly one file, and any other encoding is refused. So proofs, averages and the next round use the same numbers.
//!
//! - [`format`]: one network's files; [`error`]: why a file is refused.
//! - [`scale`]: the one scale of a tensor; [`rounding`]: rounds exact fractions to it.
//! - [`stretch`]: where the evaluation does not read; [`unread`]: what the base holds there.
//!
//! This crate uses no disk and no floats, and compiles for browsers.

pub mod error;
pub mod format;
pub mod rounding;
pub mod scale;
pub mod stretch;
pub mod unread;

pub use error::WeightFileError;
pub use format::{BuiltFile, Format, WeightsFile};
pub use scale::ScaledTensor;
pub use unread::{Changed, Unread};
