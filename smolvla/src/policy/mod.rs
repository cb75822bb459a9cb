//! The policy: its weights, its model in candle, and its file.
//!
//! - [`profile`]: named sets of dimensions. [`init`]: random weights from a seed.
//! - [`weights`]: plain `f32` weights, frozen and expert.
//! - [`model`]: the policy in candle. [`device`] finds GPUs, [`frozen`] sets the frozen half's place and precision, and [`memory`] keeps
//!   freed memory.
//! - [`tokenizer`]: reads instructions, with a trained tokenizer or hashed words.
//! - [`policy_file`]: a whole policy as one file.
//! - [`random`]: random numbers.

pub mod device;
pub mod frozen;
pub mod init;
pub mod memory;
pub mod model;
pub mod policy_file;
pub mod profile;
pub mod random;
pub mod tokenizer;
pub mod weights;
