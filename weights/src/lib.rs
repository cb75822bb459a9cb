//! Expert weights as they travel: the int16 tensors and the scales that the evaluation reads, in a safetensors file.
//!
//! Equal weights have exactly one file, on every machine, and a file that is written in another way is refused. So what a proof is
//! about, what is averaged, and what the next round starts from are the same numbers, and nobody rounds them in between.
//!
//! A short tour:
//! - [`format`]: the files of one network's weights, read strictly and written canonically; [`error`]: why a file is refused.
//! - [`scale`]: the one scale that a tensor has; [`rounding`]: how exact fractions are rounded to it.
//! - [`stretch`]: where the evaluation does not read; [`unread`]: what the base holds there. An update has to leave it as it was.
//!
//! This crate knows no disk and no floats, and it compiles for browsers.

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
