//! Between what is said on the wire and what it means.

use crate::{aggregator::Aggregator, proto, request::RequestError};
use zk0_ledger::{governance::OpenProposal, receipt::Receipt};

impl From<Receipt> for proto::Receipt {
    fn from(receipt: Receipt) -> Self {
        Self {
            index: receipt.index,
            entry: receipt.entry,
            // Checkpoints are text by their specification.
            checkpoint: String::from_utf8_lossy(&receipt.checkpoint).into_owned(),
            inclusion: receipt.proof.iter().map(|hash| hash.0.to_vec()).collect(),
        }
    }
}

/// How the network is governed, as far as the first `published` entries go.
pub fn governance_info(
    aggregator: &Aggregator,
    published: u64,
) -> Result<proto::GovernanceInfo, RequestError> {
    let state = aggregator.state();
    let mut proposals = Vec::new();
    for (number, open) in state.proposals() {
        if let Some(receipt) = aggregator.proposal(*number, published)? {
            proposals.push(open_proposal(open, receipt));
        }
    }
    Ok(proto::GovernanceInfo {
        rules: borsh::to_vec(state.rules())
            .map_err(|error| RequestError::Internal(error.to_string()))?,
        next_proposal: state.next_proposal(),
        proposals,
        now_ms: aggregator.now_ms(),
    })
}

fn open_proposal(open: &OpenProposal, receipt: Receipt) -> proto::OpenProposal {
    let tally = open.tally();
    let weight = |sum: u128| u64::try_from(sum).unwrap_or(u64::MAX);
    proto::OpenProposal {
        receipt: Some(receipt.into()),
        for_it: weight(tally.for_it),
        against: weight(tally.against),
        abstained: weight(tally.abstained),
        vetoes: weight(tally.vetoes),
        electorate: weight(tally.electorate),
        voting_ends_ms: open.voting_ends_ms,
        veto_ends_ms: open.veto_ends_ms,
    }
}
