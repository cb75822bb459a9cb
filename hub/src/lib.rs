//! Publishes folders as models on the Hugging Face Hub, by its HTTP API: the one that Python's `huggingface_hub` uses without Xet.
//!
//! - [`repository`]: the name of a repository. [`target`]: on which Hub it is, and who writes.
//! - [`local_file`]: the files that are published, with their digests.
//! - [`publish`]: creates the repository, uploads what is missing, and commits. Nothing is lost if that is cut at any moment: the commit is the
//!   last request, and a second run uploads what is missing.
//! - [`lfs`]: large files. [`client`]: requests, and what answers mean. [`error`]: what went wrong, and what to do.

pub mod client;
pub mod error;
pub mod lfs;
pub mod local_file;
pub mod publish;
pub mod repository;
pub mod target;

pub use error::PublishError;
pub use publish::{publish, PublishedCommit};
pub use repository::Repository;
pub use target::PublishTarget;
