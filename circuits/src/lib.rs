//! What zk0 proves, as one `no_std` crate that runs natively and inside the SP1 guest.
//!
//! A short tour:
//! - [`digest`]: 32-byte digests and domain-separated SHA-256.
//! - [`claim`]: the public values of a proof, the statement a contribution makes.
//! - [`dataset`]: what a dataset commitment commits to.
#![cfg_attr(not(feature = "std"), no_std)]
extern crate alloc;

pub mod claim;
pub mod dataset;
pub mod digest;

pub use claim::{Claim, Losses, WeightsDigest, CLAIM_VERSION};
pub use dataset::DatasetCommitment;
pub use digest::{Digest, NodeId};
