//! The policy: its weights, its model in candle, and the file that holds all of it.
//!
//! - [`profile`] has named sets of dimensions. [`init`] makes random weights for a configuration from a seed.
//! - [`weights`] has the weights as plain `f32`, in two halves: the frozen one and the expert.
//! - [`model`] is the policy in candle. [`device`] finds GPUs, [`frozen`] says where and how exactly the frozen half is computed, and
//!   [`memory`] keeps freed memory for the next step.
//! - [`tokenizer`] reads instructions: with the policy's own tokenizer, or by hashing words.
//! - [`policy_file`] is a whole policy as one file.
//! - [`random`] has the random numbers of initialisation and training.

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
