//! The protocol of a zk0 network: its entries, its rules, the state machine, and the formats of its transparency log.
//!
//! This crate is pure. It has no disk, no clock, no threads and no sockets, and it compiles for browsers and for SP1's guest.
//!
//! A short tour:
//! - [`entries`]: what the log holds ([`entries::entry`]) and its canonical encoding ([`entries::codec`]); how a network begins
//!   ([`entries::genesis`]); what nodes and governors sign ([`entries::signed`]); entries whose signatures were verified
//!   ([`entries::authentic`], which takes decompressed keys from [`entries::known_keys`]); why a contribution is refused
//!   ([`entries::refusal::code`], and with details for people [`entries::refusal`]); which guest program the proofs are of ([`entries::program`]).
//! - [`rules`]: the rules of a network ([`rules::network_rules`]) and how they change ([`rules::governance`]); the state of a network
//!   after its entries so far ([`rules::state`]); which entry may come next and what it changes ([`rules::apply`], a pure function);
//!   which fields of a claim the ledger determines ([`rules::bindings`]).
//! - [`challenge`]: where the randomness of challenges comes from, and how it is verified.
//! - [`evaluation_set`]: which frames of a recording a node commits to.
//! - [`tlog`]: RFC 6962 trees, C2SP checkpoints, cosignatures, tiles, receipts.
//! - [`request_head`]: what a sender signs for each request that changes something. [`pruning`]: what an operator signs about blobs that are
//!   no longer kept.
//! - [`blob`]: bytes that are named by their SHA-256.
//! - [`public_key`]: how ed25519 public keys are read; [`quote`]: how messages quote what a stranger wrote; [`counted`]: numbers of
//!   things, for people.
//! - `rpc`, with the feature `rpc`: the generated gRPC messages, and the conversions between them and the types above.

pub mod blob;
pub mod challenge;
pub mod counted;
pub mod entries;
pub mod evaluation_set;
pub mod pruning;
pub mod public_key;
pub mod quote;
pub mod recording_rules;
pub mod request_head;
#[cfg(feature = "rpc")]
pub mod rpc;
pub mod rules;
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
