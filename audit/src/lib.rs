//! Audits a ledger without trust in anyone.
//!
//! - [`auditor`]: what an audit checks beyond the ledger's rules, entry by entry: proofs, refusals, datasets and averages ([`checks`]).
//!   Several threads check ([`queue`]), and [`account`] records what was checked and what was not. [`depth`]: how much an audit reads.
//!   [`trusted_programs`]: what the auditor answers for.
//! - [`blob_check`]: checks the digests of blobs in a ledger's folder.
//! - [`log_source`]: finds logs by address or folder. [`fetch`]: fetches what an audit reads, by default into [`fetch::temporary`] folders.
//! - [`run`]: one audit. [`watch`]: repeated audits of what is new. [`fetch::behind`]: what it means that a log shows less than before.
//! - [`verified_entries`]: audits a folder and returns the entries. [`fsck`]: checks a folder. [`known_checkpoint`]: reads a checkpoint.
//! - [`report`]: the verdict, the history in numbers, and the page for a browser.

pub mod account;
pub mod auditor;
pub mod blob_check;
pub mod checks;
pub mod depth;
pub mod fetch;
pub mod fsck;
pub mod known_checkpoint;
pub mod log_source;
pub mod queue;
pub mod report;
pub mod run;
pub mod trusted_programs;
pub mod verified_entries;
pub mod watch;

pub use auditor::Auditor;
pub use depth::Depth;
pub use trusted_programs::TrustedPrograms;
