//! The append-only ledger: what happened in a network, in an order nobody can change.
//!
//! A short tour:
//! - [`entry`]: what the log holds, one canonical encoding.
//! - [`rules`]: the rules of a network, fixed in its genesis.
//! - [`signed`]: statements signed by nodes.
//! - [`refusal`]: the named reasons for which a contribution is refused.

pub mod entry;
pub mod refusal;
pub mod rules;
pub mod signed;

pub use entry::{Body, Entry};
pub use refusal::Refusal;
pub use rules::Rules;
pub use signed::Signed;
