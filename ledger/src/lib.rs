//! The append-only ledger: what happened in a network, in an order nobody can change.
//!
//! A short tour, from what is said to how it is kept:
//! - [`entry`]: what the log holds; [`codec`]: its one canonical encoding; [`genesis`]: what founds a network.
//! - [`rules`]: the rules of a network, fixed in its genesis.
//! - [`signed`]: statements signed by nodes.
//! - [`refusal`]: the named reasons for which a contribution is refused; [`violation`]: those for which an entry is.
//! - [`state`]: what a network is after the entries so far; [`apply`]: which entry may come next and what it changes, a
//!   pure function; [`bindings`]: what the ledger fixes about a claim.
//! - [`tree`], [`checkpoint`], [`receipt`]: RFC 6962, C2SP signed checkpoints, and a node's proof of inclusion.
//! - [`log`]: the log on disk, over [`store`] (RocksDB) and [`folder`]; [`blobs`] beside it.
//! - [`replay`]: an auditor reads it all again and believes nothing.

pub mod apply;
pub mod bindings;
pub mod blobs;
pub mod checkpoint;
pub mod codec;
pub mod entry;
pub mod error;
pub mod folder;
pub mod genesis;
mod history;
pub mod log;
pub mod receipt;
pub mod refusal;
pub mod replay;
pub mod rules;
pub mod signed;
pub mod state;
pub mod store;
pub mod tree;
pub mod violation;

pub use bindings::ExpectedClaim;
pub use blobs::{BlobError, BlobWriter, Blobs};
pub use checkpoint::Checkpoint;
pub use entry::{Body, Entry, Genesis};
pub use error::LedgerError;
pub use log::Ledger;
pub use receipt::Receipt;
pub use refusal::Refusal;
pub use replay::{replay, Finding, Recheck, Report};
pub use rules::Rules;
pub use signed::Signed;
pub use state::State;
pub use violation::RuleViolation;
