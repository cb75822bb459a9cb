//! What weights are worth.
//!
//! - [`mod@evaluate`]: a claim's flow-matching loss.
//! - [`action_error`]: compares sampled actions with a recording's.
//! - [`fixed_point`]: weights and samples in a claim's form. [`calibrate`] chooses its ranges, and [`fidelity`] compares its loss with the
//!   float32 one.

pub mod action_error;
pub mod calibrate;
pub mod evaluate;
pub mod fidelity;
pub mod fixed_point;
