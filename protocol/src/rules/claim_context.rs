//! What verifying one claim reads of a state. Its size does not depend on the history, so a claim can be verified later, or by
//! another thread.

use crate::entries::program::Program;
use crate::entries::refusal::code::RefusalCode;
use crate::entries::refusal::Refusal;
use crate::rules::bindings::ClaimBindings;
use crate::rules::network_rules::Rules;
use crate::rules::state::State;
use crate::rules::violation::RuleViolation;
use borsh::{BorshDeserialize, BorshSerialize};
use zk0_circuits::{Claim, Mode, NodeId};

/// How contributions are verified: the rules and guest program in force, and the claims' evaluation and proofs.
#[derive(Clone, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct VerificationTerms {
    /// The rules.
    pub rules: Rules,
    /// The guest program.
    pub program: Program,
    /// The evaluation specification, encoded as in the genesis.
    pub evaluation: Vec<u8>,
    /// How the evaluation is proven.
    pub mode: Mode,
}

/// The part of a state for verifying a node's claims: its enrolment and commitment in the open round, and the terms.
#[derive(Clone, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct ClaimContext {
    bindings: ClaimBindings,
    terms: VerificationTerms,
}

impl State {
    /// The context of the claims of `node`.
    pub fn claim_context(&self, node: &NodeId) -> ClaimContext {
        ClaimContext {
            bindings: self.claim_bindings(node),
            terms: VerificationTerms {
                rules: self.rules.clone(),
                program: self.program.clone(),
                evaluation: self.genesis.evaluation.clone(),
                mode: self.genesis.mode,
            },
        }
    }
}

impl ClaimContext {
    /// The terms for verifying contributions.
    pub fn terms(&self) -> &VerificationTerms {
        &self.terms
    }

    /// The rules in force.
    pub fn rules(&self) -> &Rules {
        &self.terms.rules
    }

    /// Whether this is the context of `node`, and the node is enrolled.
    pub fn is_of_enrolled(&self, node: &NodeId) -> bool {
        self.bindings.standing(node).is_some()
    }

    /// [`State::check_claim`] for this node.
    pub fn check_claim(&self, claim: &Claim, time_ms: u64) -> Result<(), Refusal> {
        self.bindings.check_claim(claim, time_ms)
    }

    /// [`ClaimBindings::check_rejected`] for this node.
    pub fn check_rejected(
        &self,
        claim: &Claim,
        reason: &RefusalCode,
        time_ms: u64,
    ) -> Result<(), RuleViolation> {
        self.bindings.check_rejected(claim, reason, time_ms)
    }
}
