//! Training curves as TensorBoard event files, which TensorBoard, Trackio and Weights & Biases read.
//!
//! - [`event_file`]: a file that gets one event after the other.
//! - [`metrics`]: what curves are called.
//! - [`event`]: TensorBoard's messages. [`record`]: how they are framed in a file.

pub mod event;
pub mod event_file;
pub mod metrics;
pub mod record;

pub use event_file::{EventFile, EventFileError};
