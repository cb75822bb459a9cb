//! The end of a round: its result is combined by the rules and evaluated on the public samples. Without accepted contributions,
//! or if the result is not taken, the base weights stay.

use crate::combine::bases::{BaseError, BaseFiles};
use crate::combine::contributions::WeightedContribution;
use crate::combine::error::CombineError;
use crate::combine::optimizers::moments::{needed, Moments};
use crate::combine::sealed::SealedFile;
use crate::combine::strategy::{self, Global};
use crate::result::{evaluate, ResultError, ResultFiles};
use crate::{Evaluation, VerifiedContribution};
use std::fmt::Display;
use std::io::Write;
use tracing::info_span;
use zk0_circuits::{Digest, NodeId};
use zk0_protocol::entries::entry::{Contributor, RoundClosed};
use zk0_protocol::rules::state::State;
use zk0_protocol::Refusal;

/// The end of a round.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RoundOutcome {
    /// The entry's body.
    pub closed: RoundClosed,
    /// The file of the new global weights; `None` if the base weights stay.
    pub file: Option<Vec<u8>>,
    /// SHA-256 of the round's new moments; `None` without moments, or if the base weights stay.
    pub moments: Option<Digest>,
}

/// Why a round cannot be closed.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum CloseError {
    /// No round is open.
    #[error("no round is open")]
    NotOpen,
    /// The given contributions are not the accepted ones.
    #[error("the ledger accepted the contributions of {accepted:?} in round {round}, but those of {given:?} were given")]
    OtherContributions {
        round: u64,
        accepted: Vec<NodeId>,
        given: Vec<NodeId>,
    },
    /// A given contribution is not the accepted one.
    #[error("the ledger accepted update {accepted} of node {node}, but update {given} was given")]
    OtherUpdate {
        node: NodeId,
        accepted: Digest,
        given: Digest,
    },
    /// The genesis does not fix the evaluation.
    #[error("evaluation: {0}")]
    Evaluation(#[from] Refusal),
    /// The strategy's base weights cannot be used.
    #[error(transparent)]
    Base(#[from] BaseError),
    /// The contributions do not combine.
    #[error(transparent)]
    Combine(#[from] CombineError),
    /// The result cannot be evaluated.
    #[error("the round's result cannot be evaluated: {0}")]
    Result(#[from] ResultError),
}

/// Computes the end of the open round from the state, its accepted contributions, in any order, and the files:
/// [`BaseFiles::read`] for the strategy, [`ResultFiles::read`] for the evaluation. `read_at` fills a buffer from a place of a
/// contribution's or the moments' file. New moments are written to `moments`.
pub fn close<E: Display>(
    state: &State,
    contributions: &[VerifiedContribution],
    bases: &BaseFiles,
    read_at: impl Fn(&Digest, u64, &mut [u8]) -> Result<(), E> + Sync,
    moments: &mut dyn Write,
    files: Option<&ResultFiles>,
) -> Result<RoundOutcome, CloseError> {
    let combining = info_span!("combine");
    let combined =
        combining.in_scope(|| combined(state, contributions, bases, read_at, moments))?;
    info_span!("evaluate").in_scope(|| end(state, combined, files))
}

/// Combines the open round's accepted contributions; `None` without any. Arguments as in [`close`].
pub fn combined<E: Display>(
    state: &State,
    contributions: &[VerifiedContribution],
    bases: &BaseFiles,
    read_at: impl Fn(&Digest, u64, &mut [u8]) -> Result<(), E> + Sync,
    moments: &mut dyn Write,
) -> Result<Option<Global>, CloseError> {
    let round = state.round().ok_or(CloseError::NotOpen)?;
    let contributors = state.contributors();
    let mut given: Vec<_> = contributions
        .iter()
        .map(VerifiedContribution::node)
        .collect();
    given.sort();
    let accepted: Vec<_> = contributors
        .iter()
        .map(|one: &Contributor| one.node)
        .collect();
    if given != accepted {
        return Err(CloseError::OtherContributions {
            round: round.number(),
            accepted,
            given,
        });
    }
    for one in contributions {
        let accepted = round.commits.get(&one.node()).map(|commit| commit.update);
        if accepted != Some(one.claim().terms.update) {
            return Err(CloseError::OtherUpdate {
                node: one.node(),
                accepted: accepted.map(|update| update.blob).unwrap_or_default(),
                given: one.claim().terms.update.blob,
            });
        }
    }
    let Some(first) = contributions.first() else {
        return Ok(None);
    };
    let evaluation = Evaluation::of(state)?;
    let format = evaluation.format();
    let bases = bases.weights(state, &evaluation)?;
    let files = contributions.iter().map(|one| {
        let blob = one.claim().terms.update.blob;
        SealedFile::new(format, one.sealed(), blob, &read_at)
    });
    let files: Vec<_> = files.collect();
    let given = contributions.iter().zip(&files).map(|(one, weights)| {
        let contributor = contributors.iter().find(|other| other.node == one.node());
        WeightedContribution {
            node: one.node(),
            weight: contributor.map_or(0, |contributor| contributor.share.into()),
            weights,
        }
    });
    let given: Vec<_> = given.collect();
    let strategy = state.rules().strategy;
    let read_moments = |blob: &Digest, place, buffer: &mut [u8]| {
        read_at(blob, place, buffer).map_err(|error| error.to_string())
    };
    let mut moments = match needed(state) {
        Some(before) => Moments::from(*before, &read_moments, moments),
        None => Moments::afresh(moments),
    };
    let unread = first.unread();
    let combined = strategy::combined(format, &given, strategy, &bases, unread, &mut moments)?;
    let digest = evaluation
        .digest_of(&combined.file)
        .map_err(CombineError::from)?;
    Ok(Some(Global {
        file: combined.file.into_bytes(),
        digest,
        moments: combined.moments,
    }))
}

/// Ends the open round, whose contributions combine to `combined`.
pub fn end(
    state: &State,
    combined: Option<Global>,
    files: Option<&ResultFiles>,
) -> Result<RoundOutcome, CloseError> {
    let round = state.round().ok_or(CloseError::NotOpen)?;
    let base = round.opened.base;
    let mut closed = RoundClosed {
        round: round.number(),
        global: base,
        contributors: state.contributors(),
        unanswered: state.unanswered(),
        evaluated: None,
    };
    let Some(result) = combined else {
        return Ok(RoundOutcome {
            closed,
            file: None,
            moments: None,
        });
    };
    closed.evaluated = evaluate(state, &base, &result, files)?;
    if closed.is_taken() {
        closed.global = result.digest;
        return Ok(RoundOutcome {
            closed,
            file: Some(result.file),
            moments: result.moments,
        });
    }
    closed
        .contributors
        .iter_mut()
        .for_each(|one| one.credits = 0);
    Ok(RoundOutcome {
        closed,
        file: None,
        moments: None,
    })
}
