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
//! - [`act`] goes from what a robot sees to its next actions.
//! - [`prefix_cache`] keeps samples on disk, so that the frozen half runs once per frame and not once per start; [`frozen`] says
//!   where and how exactly it runs, [`device`] finds GPUs.
//! - [`train`] fits the expert to samples ([`batch`]) with AdamW ([`optimizer`]) along a [`schedule`], and can be stopped at any
//!   moment; [`adaptive`] has the rules by which a federation's losses change its rates. [`mod@evaluate`] gives the loss at
//!   chosen noise and times, which is what a claim is about; [`action_error`] samples actions and compares them.
//! - [`fixed_point`] brings weights and samples into the form that a claim evaluates; [`calibrate`] chooses its ranges from
//!   data, and [`fidelity`] compares its loss with the float32 one.
//! - [`config`] has every dimension, [`profile`] named sets of them; [`layout`] the tensors that follow from it, by
//!   LeRobot's names; [`weights`] their values as plain `f32`; [`init`] a seeded start; [`inference`] what else a policy acts by;
//!   [`policy_file`] a whole policy as one file, its tokenizer within; [`checkpoint`] a folder of LeRobot's, read and written ([`lerobot_config`] and
//!   [`vlm_config`] its configuration, [`safetensors_file`] its weights).
//!
//! The only code that knows sizes is [`profile`]: the `tiny` fixture, the `micro` profile of the demo and
//! the published model run through the same functions.

pub mod act;
pub mod action_error;
pub mod adaptive;
pub mod batch;
pub mod calibrate;
pub mod cameras;
pub mod checkpoint;
pub mod config;
pub mod dataset;
pub mod device;
pub mod error;
pub mod evaluate;
pub mod fidelity;
pub mod fixed_point;
pub mod frozen;
pub mod hub;
pub mod image;
pub mod inference;
pub mod init;
pub mod layout;
pub mod lerobot_config;
pub mod memory;
pub mod model;
pub mod optimizer;
pub mod policy_file;
pub mod prefix_cache;
pub mod profile;
pub mod random;
pub mod recording;
pub mod safetensors_file;
mod safetensors_writer;
pub mod sample;
pub mod schedule;
pub mod tokenizer;
pub mod train;
pub mod trained_tokenizer;
pub mod vlm_config;
pub mod weights;

pub use checkpoint::Checkpoint;
pub use config::PolicyConfig;
pub use error::PolicyError;
pub use lerobot_config::LeRobotConfig;
pub use profile::Profile;
pub use weights::{ExpertWeights, Policy, TensorData};
