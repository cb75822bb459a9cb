//! Blobs in an object store: a bucket of S3 or of a service that speaks its protocol, of Google Cloud Storage, a container of Azure, or
//! another folder.
//!
//! - [`address`]: which store an address names, and with which credentials it is opened; `objects`: what is stored there; [`waiting`]: how long
//!   it is waited for, and where.
//! - [`bucket`]: what [`zk0_ledger::blobs::store`] asks of a store, with `reading` and `sent`, what others put there by themselves;
//!   [`public_log`]: a published log in a bucket that anybody may read.
//!
//! The protocols and their signatures are those of the crate `object_store`.

pub mod address;
pub mod bucket;
mod objects;
pub mod public_log;
mod reading;
mod sent;
pub mod waiting;

pub use bucket::Bucket;
