//! The witnesses that a network's rules require, read from its entries without a replay, for programs that publish or copy a log.

use crate::entries::entry::Body;
use crate::entries::proposal::{Action, Outcome};
use crate::rules::network_rules::Rules;
use crate::tlog::witness_policy::WitnessPolicy;
use std::collections::BTreeMap;

/// The required witnesses. Only a replay checks the entries.
#[derive(Clone, Debug, Default)]
pub struct RequiredWitnesses {
    rules: Rules,
    /// Proposed rules, by the proposal's number.
    proposed: BTreeMap<u64, Rules>,
}

impl RequiredWitnesses {
    /// Adds the next entry.
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

    /// The policy in the rules in force; [`WitnessPolicy::none`] without witnesses.
    pub fn policy(&self) -> Result<WitnessPolicy, String> {
        self.rules.witnesses()
    }
}
