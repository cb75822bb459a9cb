//! The proof that nodes and the aggregator exchange.

/// A compressed proof and what it proves.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Proof {
    /// bincode of SP1's `SP1Proof::Compressed`, the input of `SP1CompressedVerifierRaw::verify_with_public_values` in `sp1-verifier`. About
    /// 1.3 MB for any program.
    pub bytes: Vec<u8>,
    /// The program's commitment: borsh([`zk0_circuits::Claim`]).
    pub public_values: Vec<u8>,
}
