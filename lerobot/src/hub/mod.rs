//! Recordings from the Hugging Face Hub, through `hf-hub`: listed, downloaded into its cache, opened there.
//!
//! The cache and its layout are those of Python's `huggingface_hub`. A recording is pinned to its revision's commit when fetched. Every
//! file's size, and a large one's SHA-256, must be as the Hub lists.

mod download;
mod error;
mod fetch;
mod listing;
mod name;
mod options;
mod recording;

pub use download::HubProgress;
pub use error::HubError;
pub use fetch::{fetch, Fetched};
pub use options::HubOptions;
pub use recording::HubRecording;
