//! The SmolVLA policy, LeRobot recordings and local training.
//!
//! A tour, in the order data flows:
//!
//! - [`image`] brings camera frames to the vision tower's size.
//! - [`model`] is the policy in candle, in two phases: [`model::prefix`] computes the per-layer key/value
//!   cache of images, language and state (frozen in training), [`model::expert`] the action expert over
//!   that cache. [`model::flow`] is the flow-matching loss.
//! - [`config`] has every dimension and the named profiles; [`layout`] the tensors that follow from it, by
//!   LeRobot's names; [`weights`] their values as plain `f32`.
//!
//! The only code that knows sizes is [`config`]: the `tiny` fixture, the `micro` profile of the demo and
//! the published model run through the same functions.

pub mod config;
pub mod error;
pub mod image;
pub mod layout;
pub mod lerobot_config;
pub mod model;
pub mod weights;

pub use config::{PolicyConfig, Profile};
pub use error::PolicyError;
pub use weights::{ExpertWeights, Policy, TensorData};
