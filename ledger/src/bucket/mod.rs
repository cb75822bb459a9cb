//! Blobs in an object store: a bucket of S3 or a service with its protocol, of Google Cloud Storage, a container of Azure, or another
//! folder.
//!
//! - [`address`]: which store an address names, and with which credentials it is opened; `objects`: what is stored there; [`waiting`]: how
//!   long and where to wait for it.
//! - [`Bucket`]: implements [`crate::blobs::store`] (`blobs`), with `reading`, `entries` for the log's entries, and `sent` for what others
//!   put there; [`public_log`]: a published log in a public bucket.
//!
//! The crate `object_store` implements the protocols and their signatures.

pub mod address;
mod blobs;
mod entries;
mod objects;
pub mod public_log;
mod reading;
mod sent;
pub mod waiting;

pub use blobs::Bucket;
pub use objects::PART_BYTES;
