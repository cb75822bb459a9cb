//! Frames of recordings as samples.
//!
//! - [`sample`]: turns a frame into a [`sample::PreparedSample`]: tokenizes the instruction, resizes the pictures ([`image`]), assigns them
//!   to camera slots ([`cameras`]), and runs the policy's frozen half.
//! - [`recording`]: prepares a recording's frames.
//! - [`prefix_cache`]: keeps samples on disk.
//! - [`image_transforms`]: changes training pictures at random.
//! - [`batch`]: makes tensors of several samples.
//! - [`ahead`]: makes samples in the background, through [`making`].

pub mod ahead;
pub mod batch;
pub mod cameras;
pub mod image;
pub mod image_transforms;
pub mod making;
pub mod prefix_cache;
pub mod recording;
pub mod sample;
