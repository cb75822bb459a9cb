//! The base weights that a strategy reads: those of the round, and those of the round before.

use crate::contribution_blobs::{read, Unreadable};
use crate::update::Evaluation;
use std::fmt::Display;
use zk0_circuits::{Digest, QuantisedWeights, WeightsDigest};
use zk0_protocol::rules::named_blobs::BlobKind;
use zk0_protocol::rules::network_rules::Strategy;
use zk0_protocol::rules::state::State;
use zk0_protocol::Refusal;

/// The files of the base weights that a combination reads.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct BaseFiles {
    /// The round's base.
    pub base: Option<Vec<u8>>,
    /// The base of the round before.
    pub earlier: Option<Vec<u8>>,
}

/// Why base weights cannot be used.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum BaseError {
    /// They were not given.
    #[error("the strategy of the round reads the base weights {0}, and they were not given")]
    NotGiven(Digest),
    /// They are not those on the ledger.
    #[error("the base weights that the strategy of the round reads: {0}")]
    Other(Refusal),
}

/// The base weights that a strategy reads.
#[derive(Clone, Debug, Default)]
pub struct Bases {
    /// The round's base.
    pub base: Option<QuantisedWeights>,
    /// The base of the round before.
    pub earlier: Option<QuantisedWeights>,
}

/// The base of the round before, if the strategy reads it in the open round, or else in the next one.
pub fn earlier(state: &State) -> Option<&WeightsDigest> {
    match state.rules().strategy {
        Strategy::FedAvgM { momentum_bps, .. } if momentum_bps > 0 => state.earlier_base(),
        _ => None,
    }
}

/// The bases to read: the round's, and that of the round before.
fn wanted(state: &State) -> (Option<&WeightsDigest>, Option<&WeightsDigest>) {
    let contributed = !state.contributors().is_empty();
    let Some(round) = state.round().filter(|_| contributed) else {
        return (None, None);
    };
    match state.rules().strategy {
        Strategy::FedAvg
        | Strategy::Median
        | Strategy::TrimmedMean { .. }
        | Strategy::Krum { .. }
        | Strategy::MultiKrum { .. }
        | Strategy::Scaffold(_) => (None, None),
        Strategy::NormClipping { .. } | Strategy::FedAdam { .. } => {
            (Some(&round.opened.base), None)
        }
        Strategy::FedAvgM { .. } => (Some(&round.opened.base), earlier(state)),
    }
}

impl BaseFiles {
    /// Reads the files for closing the open round.
    pub fn read<E: Display>(
        state: &State,
        get: impl Fn(&Digest, u64) -> Result<Vec<u8>, E>,
    ) -> Result<Self, Unreadable<E>> {
        let file = |kind, weights: Option<&WeightsDigest>| {
            let file = weights.map(|weights| read(kind, &weights.blob, state.rules(), &get));
            file.transpose()
        };
        let (base, earlier) = wanted(state);
        Ok(Self {
            base: file(BlobKind::Weights, base)?,
            earlier: file(BlobKind::Weights, earlier)?,
        })
    }

    /// The weights, checked against the ledger.
    pub(crate) fn weights(
        &self,
        state: &State,
        evaluation: &Evaluation,
    ) -> Result<Bases, BaseError> {
        let weights = |file: &Option<Vec<u8>>, named: Option<&WeightsDigest>| {
            let Some(named) = named else { return Ok(None) };
            let file = file.as_ref().ok_or(BaseError::NotGiven(named.blob))?;
            let weights = evaluation.check_update(file, named);
            weights.map(Some).map_err(BaseError::Other)
        };
        let (base, earlier) = wanted(state);
        Ok(Bases {
            base: weights(&self.base, base)?,
            earlier: weights(&self.earlier, earlier)?,
        })
    }
}
