//! The formats of a transparency log: RFC 6962 and the C2SP specifications.

pub mod bundle;
pub mod checkpoint;
pub mod cosignature;
pub mod cosigner;
pub mod decimal;
pub mod key_rotation;
pub mod layout;
pub mod names;
pub mod receipt;
pub mod tlog_proof;
pub mod tree;
pub mod verifier_key;
pub mod witness;
pub mod witness_policy;
