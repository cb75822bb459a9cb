//! Frames of recordings as samples.
//!
//! - [`sample`] turns one frame into a [`sample::PreparedSample`]: it makes tokens of the instruction, brings the pictures to size
//!   ([`image`]), puts them into the policy's camera slots ([`cameras`]), and runs the frozen half of the policy once.
//! - [`recording`] prepares the frames of a recording, normalised by its statistics.
//! - [`prefix_cache`] keeps samples on disk.
//! - [`image_transforms`] changes the pictures of training frames at random.
//! - [`batch`] makes tensors of several samples, wherever they come from.
//! - [`ahead`] makes samples in the background, before a step takes them. [`making`] is what it needs of a source for that.

pub mod ahead;
pub mod batch;
pub mod cameras;
pub mod image;
pub mod image_transforms;
pub mod making;
pub mod prefix_cache;
pub mod recording;
pub mod sample;
