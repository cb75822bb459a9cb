//! The SmolVLA policy in candle, and local training.
//!
//! The folders, in the order in which data flows:
//!
//! - [`policy`] is the policy itself: its weights, its model in candle with fast kernels, and the file that holds a whole policy.
//! - [`frames`] turns the frames of recordings into samples, and keeps samples on disk so that the frozen half of the policy runs
//!   once per frame.
//! - [`measure`] computes what a policy's weights are worth: the flow-matching loss at chosen noise and times, which is what a claim
//!   is about, the error of sampled actions, and the form in fixed point that a claim evaluates.
//! - [`train`] fits the expert to samples. Training can be stopped at any moment and resumed.
//!
//! Recordings, policy folders of LeRobot and the dimensions of a policy are in [`zk0_lerobot`].
//!
//! Only [`policy::profile`] knows sizes. The `tiny` fixture, the `micro` profile of the demo and the published model run through
//! the same functions.

pub mod error;
pub mod frames;
pub mod measure;
pub mod policy;
pub mod train;

pub use error::PolicyError;
pub use policy::profile::Profile;
pub use policy::weights::{ExpertWeights, Policy};
pub use zk0_lerobot::PolicyConfig;
