//! Blobs in an object store: a bucket of S3 or of a service that speaks its protocol, of Google Cloud Storage, a container of Azure, or
//! another folder.
//!
//! - [`address`]: which store an address names, and with which credentials it is opened; [`bucket`]: what [`zk0_ledger::blobs::store`] asks
//!   of a store; [`waiting`]: how long it is waited for, and where.
//!
//! The protocols and their signatures are those of the crate `object_store`.

pub mod address;
pub mod bucket;
pub mod waiting;

pub use bucket::Bucket;
