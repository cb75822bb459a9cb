//! What an auditor answers for: guest programs and evaluations unknown to this release.

use borsh::{BorshDeserialize, BorshSerialize};
use std::collections::BTreeSet;
use zk0_circuits::Digest;

/// Guest programs and evaluations that the auditor named.
#[derive(Clone, Debug, Default, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct TrustedPrograms {
    /// Verifying keys of guest programs, as in a genesis.
    pub programs: BTreeSet<Vec<u8>>,
    /// Digests of evaluations.
    pub evaluations: BTreeSet<Digest>,
}
