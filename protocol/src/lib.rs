//! The protocol of a zk0 network: entries, rules, state machine, and transparency log formats.
//!
//! This crate is pure: no disk, clock, threads or sockets. It compiles for browsers and for SP1's guest.
//!
//! ```
//! use std::fs::read;
//! use zk0_protocol::tlog::{bundle, checkpoint::Checkpoint, tree::Frontier};
//! use zk0_protocol::{Body, Entry};
//!
//! let entries = read("../tests/fixtures/export/tile/entries/000.p/17")?;
//! let entries = bundle::split(&entries, 17)?;
//! let Body::Genesis(genesis) = Entry::decode(entries[0])?.body else { panic!() };
//! let signed = read("../tests/fixtures/export/checkpoint")?;
//! let signed = Checkpoint::open(&signed, genesis.origin(), &genesis.log_key)?;
//! let mut tree = Frontier::default();
//! for entry in entries {
//!     tree.push(entry)?;
//! }
//! assert_eq!(tree.root()?, signed.root);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! A short tour:
//! - [`entries`]: the log's entries ([`entries::entry`]) and their encoding ([`entries::codec`]); how a network begins
//!   ([`entries::genesis`]); what nodes and governors sign ([`entries::signed`]); verified signatures ([`entries::authentic`],
//!   with keys from [`entries::known_keys`]); why a contribution is refused ([`entries::refusal::code`], and [`entries::refusal`]
//!   for people); the proofs' guest program ([`entries::program`]).
//! - [`rules`]: a network's rules ([`rules::network_rules`]) and how they change ([`rules::governance`]); its state
//!   ([`rules::state`]); which entry may come next and what it changes ([`rules::apply`], a pure function); the fields of a claim
//!   that the ledger determines ([`rules::bindings`]).
//! - [`challenge`]: the randomness of challenges, and its verification.
//! - [`evaluation_set`]: the drawn frames of a dataset.
//! - [`tlog`]: RFC 6962 trees, C2SP checkpoints, cosignatures, tiles, receipts. [`log_keys`]: the keys that a log has had.
//! - [`signed_statement`]: signed statements. [`request_head`]: the signed heads of requests. [`pruning`]: the operator's statement
//!   on blobs no longer kept.
//! - [`blob`]: bytes named by their SHA-256.
//! - [`public_key`]: reads ed25519 public keys; [`quote`]: quotes a stranger's text; [`counted`]: counts for people;
//!   [`growing_waits`]: when a server is asked again.
//! - `rpc`, with the feature `rpc`: the generated gRPC messages, and their conversions.

pub mod blob;
pub mod challenge;
pub mod counted;
pub mod entries;
pub mod evaluation_set;
pub mod growing_waits;
pub mod log_keys;
pub mod pruning;
pub mod public_key;
pub mod quote;
pub mod recording_rules;
pub mod request_head;
#[cfg(feature = "rpc")]
pub mod rpc;
pub mod rules;
pub mod signed_statement;
pub mod tlog;

pub use entries::authentic::AuthenticEntry;
pub use entries::entry::{Body, Entry};
pub use entries::genesis::Genesis;
pub use entries::refusal::code::RefusalCode;
pub use entries::refusal::Refusal;
pub use entries::signed::Signed;
pub use rules::bindings::ExpectedClaim;
pub use rules::network_rules::Rules;
pub use rules::state::State;
pub use rules::violation::RuleViolation;
pub use tlog::checkpoint::Checkpoint;
pub use tlog::receipt::Receipt;
pub use tlog::tlog_proof::TlogProof;
pub use tlog::verifier_key::VerifierKey;
pub use tlog::witness_policy::WitnessPolicy;
