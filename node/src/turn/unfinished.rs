//! What a node keeps of an open round. A node that restarts goes on with it: it cannot commit to another update in the round, and a
//! decision is final.

use crate::error::ParticipantError;
use crate::state_files::{self, at, broken};
use borsh::{BorshDeserialize, BorshSerialize};
use std::io;
use std::path::{Path, PathBuf};
use zk0_circuits::{Claim, Digest, Terms};
use zk0_files::bounded_file;
use zk0_protocol::RefusalCode;
use zk0_prover::program::PreparedClaim;

/// A [`RoundParticipation`] at the beginning of a file.
const PART_BYTES: u64 = 3 * 32 + 8;
/// Room for the fields beside an update.
const FIELDS_BYTES: u64 = 1 << 10;
/// The argument about 256 samples at the published size has a few megabytes.
const MAX_CLAIM_BYTES: u64 = 256 << 20;
/// The texts of a refusal have some hundred bytes.
const MAX_DECIDED_BYTES: u64 = 1 << 20;

/// An update that the node has committed to, or is about to commit to.
#[derive(Clone, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct UnfinishedUpdate {
    /// Where it belongs.
    pub of: RoundParticipation,
    /// Samples on which it is evaluated.
    pub eval_samples: u32,
    /// The update, as it travels.
    pub file: Vec<u8>,
}

/// A node's part in one round.
#[derive(Clone, Copy, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct RoundParticipation {
    /// The network.
    pub network: Digest,
    /// The round.
    pub round: u64,
    /// The file of its base weights.
    pub base: Digest,
    /// The root of the node's dataset.
    pub dataset: Digest,
}

impl UnfinishedUpdate {
    fn path(state: &Path) -> PathBuf {
        state.join("unfinished-update")
    }

    /// The kept update of this part, of at most `limit` bytes.
    pub fn read(
        state: &Path,
        of: &RoundParticipation,
        limit: u64,
    ) -> Result<Option<Self>, ParticipantError> {
        let kept: Option<Self> = read(&Self::path(state), limit.saturating_add(FIELDS_BYTES))?;
        Ok(kept.filter(|kept| kept.of == *of))
    }

    /// Keeps the update on disk.
    pub fn keep(&self, state: &Path) -> Result<(), ParticipantError> {
        keep(&Self::path(state), self)
    }
}

/// The aggregator's decision on a node's contribution.
#[derive(Clone, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct Decided {
    /// What the contribution belongs to.
    pub of: RoundParticipation,
    /// Why the contribution is refused; `None` if it is accepted.
    pub refusal: Option<RefusalCode>,
}

impl Decided {
    fn path(state: &Path) -> PathBuf {
        state.join("decided")
    }

    /// The decision on this part, if there is one.
    pub fn read(state: &Path, of: &RoundParticipation) -> Result<Option<Self>, ParticipantError> {
        let kept: Option<Self> = read(&Self::path(state), MAX_DECIDED_BYTES)?;
        Ok(kept.filter(|kept| kept.of == *of))
    }

    /// Keeps the decision. Update and proof stay until the round has closed, because the aggregator may lose them.
    pub fn keep(&self, state: &Path) -> Result<(), ParticipantError> {
        keep(&Self::path(state), self)
    }
}

/// The root of the dataset with which the node has begun the round, if it has.
pub fn begun(
    state: &Path,
    network: &Digest,
    round: u64,
) -> Result<Option<Digest>, ParticipantError> {
    for path in [Decided::path(state), UnfinishedUpdate::path(state)] {
        // Both files begin with the part. The update may be large.
        let start = bounded_file::start_if_there(&path, PART_BYTES).map_err(at(&path))?;
        let part = start.map(|start| borsh::from_slice::<RoundParticipation>(&start));
        let part = part
            .transpose()
            .map_err(|error| broken(&path, error.to_string()))?;
        let own = part.filter(|part| (part.network, part.round) == (*network, round));
        if let Some(part) = own {
            return Ok(Some(part.dataset));
        }
    }
    Ok(None)
}

/// The kept claim of these terms, if its argument is whole.
pub fn read_claim(state: &Path, terms: &Terms) -> Result<Option<PreparedClaim>, ParticipantError> {
    let kept: Option<PreparedClaim> = read(&claim_path(state), MAX_CLAIM_BYTES)?;
    Ok(kept.filter(|kept| {
        kept.claim.terms == *terms && kept.input.claim().is_ok_and(|claim| claim == kept.claim)
    }))
}

/// Keeps a claim on disk.
pub fn keep_claim(state: &Path, claim: &PreparedClaim) -> Result<(), ParticipantError> {
    keep(&claim_path(state), claim)
}

/// A claim with its proof, as submitted.
#[derive(Clone, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct ProvenClaim {
    /// The claim.
    pub claim: Claim,
    /// The blob with its proof. No other proof of the claim has the same bytes.
    pub proof: Vec<u8>,
}

impl ProvenClaim {
    fn path(state: &Path) -> PathBuf {
        state.join("unfinished-proof")
    }

    /// The kept claim of these terms.
    pub fn read(state: &Path, terms: &Terms) -> Result<Option<Self>, ParticipantError> {
        let kept: Option<Self> = read(&Self::path(state), MAX_CLAIM_BYTES)?;
        Ok(kept.filter(|kept| kept.claim.terms == *terms))
    }

    /// The kept claim of this part.
    pub fn in_round(
        state: &Path,
        of: &RoundParticipation,
    ) -> Result<Option<Self>, ParticipantError> {
        let kept: Option<Self> = read(&Self::path(state), MAX_CLAIM_BYTES)?;
        Ok(kept.filter(|ProvenClaim { claim, .. }| {
            let Terms {
                network,
                round,
                base,
                dataset,
                ..
            } = &claim.terms;
            (*network, *round, base.blob, dataset.root)
                == (of.network, of.round, of.base, of.dataset)
        }))
    }

    /// Keeps claim and proof on disk.
    pub fn keep(&self, state: &Path) -> Result<(), ParticipantError> {
        keep(&Self::path(state), self)
    }
}

/// Removes the update, the claim and the proof of a closed round.
pub fn remove(state: &Path) -> Result<(), ParticipantError> {
    for path in [
        UnfinishedUpdate::path(state),
        claim_path(state),
        ProvenClaim::path(state),
    ] {
        match std::fs::remove_file(&path) {
            Err(error) if error.kind() != io::ErrorKind::NotFound => return Err(at(&path)(error)),
            _ => {}
        }
    }
    Ok(())
}

fn claim_path(state: &Path) -> PathBuf {
    state.join("unfinished-claim")
}

fn read<T: BorshDeserialize>(path: &Path, limit: u64) -> Result<Option<T>, ParticipantError> {
    let Some(bytes) = state_files::read(path, limit)? else {
        return Ok(None);
    };
    let kept = borsh::from_slice(&bytes).map_err(|error| broken(path, error.to_string()))?;
    Ok(Some(kept))
}

fn keep(path: &Path, value: &impl BorshSerialize) -> Result<(), ParticipantError> {
    let bytes = borsh::to_vec(value).map_err(at(path))?;
    state_files::write(path, &bytes)
}
