//! Recordings from the Hugging Face Hub, through `hf-hub`: listed, downloaded into its cache, opened from there.
//!
//! The cache is the one that Python's `huggingface_hub` uses, laid out alike. A recording is pinned to the commit that its
//! revision names when it is fetched; every file is checked against the size, and large ones against the SHA-256, that the Hub lists.

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
