//! A compressed proof, as nodes and the aggregator exchange it.

/// A compressed proof and what it proves.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Proof {
    /// bincode of SP1's `SP1Proof::Compressed`: what `SP1CompressedVerifierRaw::verify_with_public_values` of
    /// `sp1-verifier` reads. About 1.3 MB whatever the program.
    pub bytes: Vec<u8>,
    /// What the program committed to: borsh([`zk0_circuits::Claim`]).
    pub public_values: Vec<u8>,
}
