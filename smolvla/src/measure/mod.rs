//! What weights are worth.
//!
//! - [`mod@evaluate`] gives the flow-matching loss at chosen noise and times, which is what a claim is about.
//! - [`action_error`] samples actions and compares them with those of a recording.
//! - [`fixed_point`] brings weights and samples into the form that a claim evaluates. [`calibrate`] chooses the ranges of that form
//!   from data, and [`fidelity`] compares its loss with the float32 one.

pub mod action_error;
pub mod calibrate;
pub mod evaluate;
pub mod fidelity;
pub mod fixed_point;
