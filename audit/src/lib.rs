//! Audits a ledger, for somebody who trusts nobody.
//!
//! A short tour:
//! - [`auditor`]: what an audit checks beyond the ledger's own rules, entry by entry: proofs, refusals, datasets and averages
//!   ([`checks`]). Several threads do the checks ([`queue`]), and an account says what was checked and what was not ([`account`]).
//!   [`depth`] says how much an audit reads, and [`named`] what the auditor answers for.
//! - [`blob_check`]: checks that the blobs of a ledger's folder have the digests that the ledger names.
//! - [`log_source`]: finds logs by their address or folder. [`fetch`]: fetches what an audit reads, into [`fetch::temporary`] folders where
//!   nobody names one.
//! - [`run`]: one run of an audit. [`watch`]: one run after another, each over what is new. [`fetch::behind`]: what it means that a log shows less than
//!   it did before.
//! - [`verified_entries`]: an audit of a ledger's folder that hands out the entries. [`fsck`]: a check that a folder is whole.
//!   [`known_checkpoint`]: reads a checkpoint that somebody has.
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
