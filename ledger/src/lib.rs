//! What a network keeps: the log on disk, the blobs beside it, backups, mirrors, and replay.
//!
//! What the entries say and which may come next is in [`zk0_protocol`]. A short tour of how they are kept:
//! - [`log`]: the log on disk, over [`store`] (RocksDB) and [`folder`]; [`group`]: entries that are written together; [`blobs`]: files
//!   beside the log, named by their SHA-256; [`clock`]: whether the writer's clock can be believed.
//! - [`replay`]: an auditor reads everything again and believes nothing.
//! - [`published`]: the log as others read it, with mirrors; [`backup`]: a copy of a ledger's folder, and the way back.
//! - [`witness_store`]: what a witness remembers, on disk.
//! - [`atomic_file`]: files that are written whole or not at all; [`bounded_file`]: files that are read up to a limit.

pub mod atomic_file;
pub mod backup;
pub mod blobs;
pub mod bounded_file;
pub mod clock;
pub mod error;
pub mod folder;
pub mod group;
mod history;
pub mod log;
pub mod published;
pub mod replay;
pub mod store;
pub mod witness_policy_file;
pub mod witness_store;

pub use blobs::{BlobError, BlobWriter, Blobs};
pub use error::LedgerError;
pub use log::Ledger;
pub use replay::{replay, Finding, Recheck, Report};
