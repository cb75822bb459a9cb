//! Training curves as event files for TensorBoard, Trackio and Weights & Biases.
//!
//! - [`event_file`]: appends events to a file.
//! - [`metrics`]: the names of curves.
//! - [`event`]: TensorBoard's messages. [`record`]: their frames in a file.

pub mod event;
pub mod event_file;
pub mod metrics;
pub mod record;

pub use event_file::{EventFile, EventFileError};
