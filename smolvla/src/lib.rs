//! The SmolVLA policy, LeRobot recordings and local training.
//!
//! A tour, in the order data flows:
//!
//! - [`dataset`] reads a LeRobotDataset: parquet rows, decoded camera frames, statistics; [`hub`] fetches one from the Hub.
//! - [`sample`] turns a frame into a [`sample::PreparedSample`]: it normalises state and actions, brings
//!   the images to size ([`image`]), makes language tokens ([`tokenizer`], [`trained_tokenizer`] for a policy's own) and runs
//!   the frozen half once.
//!   [`recording`] does so for a whole dataset.
//! - [`model`] is the policy in candle, in two phases: [`model::prefix`] computes the per-layer key/value
//!   cache of images, language and state (frozen in training), [`model::expert`] the action expert over
//!   that cache. [`model::flow`] is the flow-matching loss.
//! - [`train`] fits the expert to prepared samples with AdamW ([`optimizer`]); [`mod@evaluate`] gives the
//!   loss at chosen noise and times, which is what a claim is about.
//! - [`fixed_point`] brings weights and samples into the form that a claim evaluates; [`calibrate`] chooses its ranges from
//!   data, and [`fidelity`] compares its loss with the float32 one.
//! - [`config`] has every dimension and the named profiles; [`layout`] the tensors that follow from it, by
//!   LeRobot's names; [`weights`] their values as plain `f32`; [`init`] a seeded start;
//!   [`policy_file`] a whole policy as one file.
//!
//! The only code that knows sizes is [`config`]: the `tiny` fixture, the `micro` profile of the demo and
//! the published model run through the same functions.

pub mod batch;
pub mod calibrate;
pub mod config;
pub mod dataset;
pub mod error;
pub mod evaluate;
pub mod fidelity;
pub mod fixed_point;
pub mod hub;
pub mod image;
pub mod init;
pub mod layout;
pub mod lerobot_config;
pub mod model;
pub mod optimizer;
pub mod policy_file;
pub mod random;
pub mod recording;
pub mod sample;
pub mod tokenizer;
pub mod train;
pub mod trained_tokenizer;
pub mod weights;

pub use config::{PolicyConfig, Profile};
pub use error::PolicyError;
pub use weights::{ExpertWeights, Policy, TensorData};
