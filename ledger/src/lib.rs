//! A network's storage: the log on disk, the blobs beside it, backups, mirrors, and replay.
//!
//! [`zk0_protocol`] defines the entries and their rules. This crate stores and reads them. A short tour:
//! - [`log`]: the log on disk, over [`store`] (RocksDB, or plain files) and [`folder`]; [`group`]: entries written together; [`blobs`]:
//!   files beside the log, named by their SHA-256; [`stored_entries`]: the log in the store of the blobs; `bucket` (feature
//!   `bucket`): that store; [`clock`]: whether the writer's clock is right.
//! - [`replay`]: a reader or the next writer verifies everything again.
//! - [`published`]: the log as others read it, and mirrors; [`backup`]: copies of a ledger's folder, and how to restore one.
//! - [`prune`]: deletes blobs that no audit needs any more; [`pruned`]: the operator's statement about them.
//! - [`witness_store`]: a witness' files.

pub mod backup;
pub mod blobs;
#[cfg(feature = "bucket")]
pub mod bucket;
pub mod clock;
pub mod error;
pub mod folder;
pub mod group;
pub mod log;
pub mod prune;
pub mod pruned;
pub mod published;
pub mod replay;
pub mod store;
pub mod stored_entries;
pub mod witness_policy_file;
pub mod witness_store;

pub use blobs::{BlobError, BlobWriter, Blobs};
pub use error::LedgerError;
pub use log::Ledger;
pub use replay::{replay, Finding, Recheck, ReplayReport};
