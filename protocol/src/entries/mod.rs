//! The log's entries: their kinds, encoding, signatures, and reasons for refusals.

pub mod authentic;
pub mod codec;
pub mod entry;
pub mod genesis;
pub mod identity;
pub mod identity_text;
pub mod known_keys;
pub mod member;
pub mod program;
pub mod proof_blob;
pub mod proposal;
pub mod refusal;
pub mod round_result;
pub mod signed;
