//! What the service answers about governance.

use crate::round::aggregator::Aggregator;
use crate::round::request::RequestError;
use zk0_protocol::rpc::federation as proto;

/// How the network is governed, as far as the first `published` entries go.
pub fn governance_info(
    aggregator: &Aggregator,
    published: u64,
) -> Result<proto::GovernanceInfo, RequestError> {
    let state = aggregator.state();
    let mut proposals = Vec::new();
    for (number, open) in state.proposals() {
        if let Some(receipt) = aggregator.proposal(*number, published)? {
            proposals.push(proto::OpenProposal::new(open, receipt));
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
