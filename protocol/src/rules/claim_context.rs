//! What the verification of one claim reads of a state. It is small however long the history is, so a claim can be verified later, or by
//! another thread, while the history goes on.

use crate::entries::program::Program;
use crate::entries::refusal::code::RefusalCode;
use crate::entries::refusal::Refusal;
use crate::rules::bindings::ClaimBindings;
use crate::rules::network_rules::Rules;
use crate::rules::state::State;
use crate::rules::violation::RuleViolation;
use borsh::{BorshDeserialize, BorshSerialize};
use zk0_circuits::{Claim, Mode, NodeId};

/// By what the contributions to a round are verified: the rules and the guest program in force, and how claims are evaluated and proven.
#[derive(Clone, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct VerificationTerms {
    /// The rules.
    pub rules: Rules,
    /// The guest program.
    pub program: Program,
    /// The evaluation specification, as the genesis encodes it.
    pub evaluation: Vec<u8>,
    /// How the evaluation is proven.
    pub mode: Mode,
}

/// What the check and the verification of a node's claims read of a state: its enrolment and commitment in the open round, and by what
/// contributions are verified.
#[derive(Clone, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct ClaimContext {
    bindings: ClaimBindings,
    terms: VerificationTerms,
}

impl State {
    /// What concerns the claims of `node`.
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
    /// By what contributions are verified.
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

    /// The check of [`State::check_claim`], of a claim of this node.
    pub fn check_claim(&self, claim: &Claim, time_ms: u64) -> Result<(), Refusal> {
        self.bindings.check_claim(claim, time_ms)
    }

    /// Whether a refusal of a claim of this node may be recorded at `time_ms` for this reason.
    pub fn check_rejected(
        &self,
        claim: &Claim,
        reason: &RefusalCode,
        time_ms: u64,
    ) -> Result<(), RuleViolation> {
        self.bindings.check_rejected(claim, reason, time_ms)
    }
}
