//! Which witnesses a network's own rules ask for, told from its entries without the state: for readers that publish or copy a
//! log, and do not replay it.

use crate::{
    entries::{
        entry::Body,
        proposal::{Action, Outcome},
    },
    rules::network_rules::Rules,
    tlog::witness_policy::WitnessPolicy,
};
use std::collections::BTreeMap;

/// A fold over a log's entries, from the first. It believes what they say: whether they follow the rules is for
/// [`zk0_ledger::replay`] to find out.
#[derive(Clone, Debug, Default)]
pub struct RequiredWitnesses {
    rules: Rules,
    /// Rules that are proposed, by number.
    proposed: BTreeMap<u64, Rules>,
}

impl RequiredWitnesses {
    /// Takes note of the next entry.
    pub fn observe(&mut self, body: &Body) {
        match body {
            Body::Genesis(genesis) => self.rules = genesis.rules.clone(),
            Body::Proposed(signed) => {
                let proposal = &signed.statement;
                if let Action::ChangeRules(rules) = &proposal.action {
                    self.proposed.insert(proposal.number, (**rules).clone());
                }
            }
            Body::ProposalSettled(settled) => {
                let rules = self.proposed.remove(&settled.proposal);
                if let (Some(rules), Outcome::Executed) = (rules, &settled.outcome) {
                    self.rules = rules;
                }
            }
            _ => {}
        }
    }

    /// The policy that the rules in force name; [`Policy::none`] where they ask for no witnesses.
    pub fn policy(&self) -> Result<WitnessPolicy, String> {
        self.rules.witnesses()
    }
}
