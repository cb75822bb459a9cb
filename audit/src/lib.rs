//! The audit of a ledger by somebody who trusts nobody.
//!
//! A short tour:
//! - [`auditor`]: what is checked beyond the ledger's own rules, entry by entry: proofs, refusals, datasets and averages
//!   ([`checks`]), by several threads ([`queue`]), with an account of what was checked and what was not ([`account`]); [`depth`]: how much of it is read.
//! - [`blob_check`]: whether the blobs that a ledger names are whole.
//! - [`log_source`]: logs by their address or folder; [`fetch`]: a copy of what an audit reads.
//! - [`run`]: one run of an audit; [`watch`]: runs again and again, of what is new.
//! - [`verified_entries`]: an audit of a ledger's folder that hands out the entries; [`fsck`]: whether a folder is whole;
//!   [`known_checkpoint`]: a checkpoint that somebody has.
//! - [`report`]: what an audit says: the verdict, the history in numbers, the page for a browser.

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
pub mod verified_entries;
pub mod watch;

pub use auditor::Auditor;
pub use depth::Depth;
