//! Publishes folders as models on the Hugging Face Hub, by the HTTP API that Python's `huggingface_hub` uses without Xet.
//!
//! - [`repository`]: its name. [`target`]: its Hub, and who writes.
//! - `local_file`: the files to publish, with digests.
//! - [`publish`]: creates the repository, uploads what is missing, and commits last: a second run continues.
//! - `lfs`: large files. `client`: requests. [`error`]: faults and remedies.

mod client;
pub mod error;
mod lfs;
mod local_file;
pub mod publish;
pub mod repository;
pub mod target;

pub use error::PublishError;
pub use publish::{publish, PublishedCommit};
pub use repository::Repository;
pub use target::PublishTarget;
