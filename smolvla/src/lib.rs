//! The SmolVLA policy in candle, and local training.
//!
//! In the order of the data's flow:
//!
//! - [`policy`]: weights, the model in candle with fast kernels, and the file of a policy.
//! - [`frames`]: turns frames of recordings into samples on disk, so that the policy's frozen half runs once per frame.
//! - [`measure`]: a claim's flow-matching loss, in float32 and in fixed point, and the error of sampled actions.
//! - [`train`]: fits the expert to samples, and resumes after a stop.
//!
//! [`zk0_lerobot`] has recordings, LeRobot's policy folders and a policy's dimensions.
//!
//! Only [`policy::profile`] knows sizes: all profiles share all functions.

pub mod error;
pub mod frames;
pub mod measure;
pub mod policy;
pub mod train;

pub use error::PolicyError;
pub use policy::profile::Profile;
pub use policy::weights::{ExpertWeights, Policy};
pub use zk0_lerobot::PolicyConfig;
