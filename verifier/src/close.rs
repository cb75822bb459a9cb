//! The end of a round: the accepted contributions are combined as the rules say. Where none was accepted, the base weights stay.

use crate::combine::contributions::CombineError;
use crate::combine::strategy::combine;
use crate::{Evaluation, VerifiedContribution};
use zk0_circuits::{Digest, NodeId};
use zk0_protocol::entries::entry::{Contributor, RoundClosed};
use zk0_protocol::rules::state::State;
use zk0_protocol::Refusal;

/// The end of a round.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Closing {
    /// The entry's body.
    pub closed: RoundClosed,
    /// The file of the new global weights; `None` when the base weights stay.
    pub file: Option<Vec<u8>>,
}

/// Why a round cannot be closed.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum CloseError {
    /// No round is open.
    #[error("no round is open")]
    NotOpen,
    /// The given contributions are not those that the ledger accepted.
    #[error("the ledger accepted the contributions of {accepted:?} in round {round}, but those of {given:?} were given")]
    OtherContributions {
        round: u64,
        accepted: Vec<NodeId>,
        given: Vec<NodeId>,
    },
    /// A given contribution is not the one that the ledger accepted.
    #[error("the ledger accepted update {accepted} of node {node}, but update {given} was given")]
    OtherUpdate {
        node: NodeId,
        accepted: Digest,
        given: Digest,
    },
    /// The genesis does not say how weights are evaluated.
    #[error("evaluation: {0}")]
    Evaluation(#[from] Refusal),
    /// The contributions do not combine.
    #[error(transparent)]
    Combine(#[from] CombineError),
}

/// Computes the end of the open round from the state and all contributions that were accepted in it, in any order.
pub fn close(state: &State, contributions: &[VerifiedContribution]) -> Result<Closing, CloseError> {
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
    let (global, file) = match contributions {
        [] => (round.opened.base, None),
        _ => {
            let strategy = state.rules().strategy;
            let global = combine(contributions, strategy, &Evaluation::of(state)?)?;
            (global.digest, Some(global.file))
        }
    };
    Ok(Closing {
        closed: RoundClosed {
            round: round.number(),
            global,
            contributors,
        },
        file,
    })
}
