//! The append-only ledger: what happened in a network, in an order nobody can change.
//!
//! A short tour, from what is said to how it is kept:
//! - [`entry`]: what the log holds; [`codec`]: its one canonical encoding; [`genesis`]: what founds a network.
//! - [`rules`]: the rules of a network; [`governance`]: how they change.
//! - [`signed`]: statements signed by nodes and governors; `public_key`: keys that were read once.
//! - [`authentic`]: entries whose signatures were verified, before the rules look at them.
//! - [`refusal`]: the named reasons for which a contribution is refused; [`violation`]: those for which an entry is.
//! - [`state`]: what a network is after the entries so far; [`apply`]: which entry may come next and what it changes, a
//!   pure function; [`bindings`]: what the ledger fixes about a claim.
//! - [`tree`], [`checkpoint`], [`receipt`]: RFC 6962, C2SP signed checkpoints, and a node's proof of inclusion.
//! - [`log`]: the log on disk, over [`store`] (RocksDB) and [`folder`]; [`group`]: where checkpoints are; [`blobs`] beside it;
//!   [`clock`]: whether the writer's clock can be believed.
//! - [`replay`]: an auditor reads it all again and believes nothing; `snapshot`: the little of a state that his checks of a
//!   claim need, to be done later or elsewhere.
//!
//! And what makes it a transparency log for everybody else:
//! - [`layout`], [`bundle`], [`tiles`]: what is served and where (C2SP tlog-tiles), and its bytes from the database;
//! - [`source`], [`published`]: a reader of such files, who trusts none of them; [`mirror`]: a ledger's folder made from them; [`backup`]: one
//!   made from another;
//! - [`verifier_key`], [`cosignature`], [`policy`]: who signed, and whose signatures are enough; [`asked_witnesses`]: by a
//!   network's own rules;
//! - [`witness`], [`witness_store`]: who cosigns only what continues what it cosigned before;
//! - [`tlog_proof`]: receipts as C2SP tlog-proof bundles, checked offline.

pub mod apply;
pub mod asked_witnesses;
pub mod authentic;
pub mod backup;
pub mod bindings;
pub mod blobs;
pub mod bundle;
pub mod checkpoint;
pub mod clock;
pub mod codec;
pub mod cosignature;
pub mod entry;
pub mod error;
pub mod folder;
pub mod genesis;
pub mod governance;
pub mod group;
mod history;
mod identity_text;
pub mod layout;
pub mod log;
pub mod mirror;
pub mod policy;
mod public_key;
pub mod published;
pub mod receipt;
pub mod refusal;
pub mod replay;
pub mod rules;
pub mod signed;
mod snapshot;
pub mod source;
pub mod state;
pub mod store;
pub mod tiles;
pub mod tlog_proof;
pub mod tree;
pub mod updates;
pub mod verifier_key;
pub mod violation;
pub mod witness;
pub mod witness_store;

pub use authentic::AuthenticEntry;
pub use bindings::ExpectedClaim;
pub use blobs::{BlobError, BlobWriter, Blobs};
pub use checkpoint::Checkpoint;
pub use entry::{Body, Entry, Genesis};
pub use error::LedgerError;
pub use log::Ledger;
pub use policy::Policy;
pub use published::PublishedLog;
pub use receipt::Receipt;
pub use refusal::Refusal;
pub use replay::{replay, Finding, Recheck, Report};
pub use rules::Rules;
pub use signed::Signed;
pub use source::Source;
pub use state::State;
pub use tlog_proof::TlogProof;
pub use verifier_key::VerifierKey;
pub use violation::RuleViolation;
