//! Contributions that a round leaves out, because the aggregator lost a file of them. Nothing depends on their blobs. An audit reports
//! each.

use crate::auditor::Auditor;
use crate::checks::RecordedClaim;
use zk0_ledger::replay::Finding;
use zk0_protocol::entries::entry::LostContribution;

impl Auditor {
    /// Takes a contribution out of the open round, as entry `index` records.
    pub(super) fn leave_out(&mut self, index: u64, lost: &LostContribution) {
        self.finish_all();
        let LostContribution { round, node } = *lost;
        let whose = |recorded: &RecordedClaim| recorded.submission.statement.claim.terms.node;
        let accepted = self
            .accepted
            .iter()
            .find(|recorded| whose(recorded) == node);
        let accepted = accepted.map(|recorded| recorded.index);
        self.missing
            .retain(|missing| Some(missing.index) != accepted);
        self.accepted.retain(|recorded| whose(recorded) != node);
        self.contributions.retain(|one| one.node() != node);
        self.found.push(Finding::note(
            index,
            format!("round {round} leaves out the accepted contribution of node {node}: the operator states that a file of it was lost"),
        ));
    }
}
