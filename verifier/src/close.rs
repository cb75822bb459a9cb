//! How a round ends: what was accepted, combined as the rules say, the base weights when nothing was.

use crate::combine::{contributions::CombineError, strategy::combine};
use crate::{Evaluation, VerifiedContribution};
use zk0_circuits::{Digest, NodeId};
use zk0_protocol::{
    entries::entry::{Contributor, RoundClosed},
    rules::state::State,
    Refusal,
};

/// The end of a round.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Closing {
    /// What goes on the ledger.
    pub closed: RoundClosed,
    /// The file of the new global weights; `None` when the base weights stay.
    pub file: Option<Vec<u8>>,
}

/// Why a round cannot be closed.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum CloseError {
    /// There is no open round.
    #[error("no round is open")]
    NotOpen,
    /// The contributions at hand are not those that the ledger accepted.
    #[error("the ledger accepted {accepted:?} in round {round}, at hand are the contributions of {at_hand:?}")]
    OtherContributions {
        round: u64,
        accepted: Vec<NodeId>,
        at_hand: Vec<NodeId>,
    },
    /// A contribution is not the one that was accepted.
    #[error(
        "node {node}'s contribution at hand is update {at_hand}, the ledger accepted {accepted}"
    )]
    OtherUpdate {
        node: NodeId,
        accepted: Digest,
        at_hand: Digest,
    },
    /// The genesis says nothing usable about the weights.
    #[error("evaluation: {0}")]
    Evaluation(#[from] Refusal),
    /// They do not combine.
    #[error(transparent)]
    Combine(#[from] CombineError),
}

/// Computes the end of the open round from the state and all contributions that were accepted in it, in any order.
pub fn close(state: &State, contributions: &[VerifiedContribution]) -> Result<Closing, CloseError> {
    let round = state.round().ok_or(CloseError::NotOpen)?;
    let contributors = state.contributors();
    let mut at_hand: Vec<_> = contributions
        .iter()
        .map(VerifiedContribution::node)
        .collect();
    at_hand.sort();
    let accepted: Vec<_> = contributors
        .iter()
        .map(|one: &Contributor| one.node)
        .collect();
    if at_hand != accepted {
        return Err(CloseError::OtherContributions {
            round: round.number(),
            accepted,
            at_hand,
        });
    }
    for one in contributions {
        let accepted = round.commits.get(&one.node()).map(|commit| commit.update);
        if accepted != Some(one.claim().terms.update) {
            return Err(CloseError::OtherUpdate {
                node: one.node(),
                accepted: accepted.map(|update| update.blob).unwrap_or_default(),
                at_hand: one.claim().terms.update.blob,
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
