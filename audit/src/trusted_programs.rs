//! What an auditor answers for: guest programs and evaluations that this release does not know.

use borsh::{BorshDeserialize, BorshSerialize};
use std::collections::BTreeSet;
use zk0_circuits::Digest;

/// Guest programs and evaluations that the auditor has named, besides those of this release.
#[derive(Clone, Debug, Default, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct TrustedPrograms {
    /// Verifying keys of guest programs, as a genesis holds them.
    pub programs: BTreeSet<Vec<u8>>,
    /// Digests of evaluations.
    pub evaluations: BTreeSet<Digest>,
}
