//! The fields of a claim that the ledger determines, so that they can be checked before anybody looks at the proof.

use crate::entries::refusal::claim_field::ClaimField;
use crate::entries::refusal::code::{RefusalCode, RoundStatement};
use crate::entries::refusal::Refusal;
use crate::rules::state::{Commit, Randomness, Round, State};
use std::fmt::Display;
use zk0_circuits::claim::challenge::challenge;
use zk0_circuits::{Claim, Digest, Disclosure, Losses, NodeId, Terms, CLAIM_VERSION};

/// The part of a claim that the ledger determines.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ExpectedClaim {
    /// The claim's terms.
    pub terms: Terms,
    /// How much the claim has to disclose of the losses.
    pub disclosure: Disclosure,
}

impl ExpectedClaim {
    /// The claim with these terms and these losses, and without a weight check.
    pub fn with(&self, losses: Losses) -> Claim {
        Claim {
            version: CLAIM_VERSION,
            terms: self.terms,
            losses,
            weight_check: None,
        }
    }
}

impl State {
    /// What the ledger determines of the claim that `node` may make in the open round.
    pub fn expected_claim(&self, node: &NodeId) -> Result<ExpectedClaim, Refusal> {
        let (round, commit) = self.commit(node)?;
        let randomness = drawn(round)?;
        let rules = self.rules();
        Ok(ExpectedClaim {
            terms: Terms {
                network: self.network,
                round: round.number(),
                node: *node,
                dataset: commit.dataset,
                evaluation: round.opened.evaluation,
                base: round.opened.base,
                update: commit.update,
                challenge: challenge(
                    &self.network,
                    round.number(),
                    node,
                    &commit.commitment,
                    &randomness.value,
                ),
                eval_samples: commit.eval_samples,
                test: rules.test(),
            },
            disclosure: rules.disclosure,
        })
    }

    /// Compares a claim with what the ledger determines: its network and round, the node's enrolment and commitment, that the node has
    /// submitted nothing in this round, and then each field.
    pub fn check_bindings(&self, claim: &Claim) -> Result<(), Refusal> {
        same(ClaimField::Version, claim.version, CLAIM_VERSION)?;
        self.check_addressed(&claim.terms.network, claim.terms.round, &claim.terms.node)?;
        let (_, commit) = self.commit(&claim.terms.node)?;
        if commit.decision.is_some() {
            return Err(already_submitted(claim));
        }
        let expected = self.expected_claim(&claim.terms.node)?;
        claim
            .check(&expected.terms, expected.disclosure)
            .map_err(|wrong| {
                let field = ClaimField::named(wrong.term).unwrap_or(ClaimField::Version);
                differs(field, wrong.claimed, wrong.expected)
            })
    }

    /// Makes the checks of [`State::check_bindings`], and checks that a claim recorded at `time_ms` is in time.
    pub fn check_claim(&self, claim: &Claim, time_ms: u64) -> Result<(), Refusal> {
        self.check_bindings(claim)?;
        match &self.round {
            Some(round) => {
                let deadline_ms = drawn(round)?.submit_deadline_ms;
                in_time(RoundStatement::Claim, round, time_ms, deadline_ms)
            }
            None => Ok(()),
        }
    }

    /// Checks that something is for this network, for the open round, and from an active node.
    pub(crate) fn check_addressed(
        &self,
        network: &Digest,
        round: u64,
        node: &NodeId,
    ) -> Result<&Round, Refusal> {
        if *network != self.network {
            return Err(RefusalCode::WrongNetwork {
                claimed: *network,
                ours: self.network,
            }
            .into());
        }
        let open = match &self.round {
            Some(open) if open.number() == round => open,
            other => {
                return Err(RefusalCode::WrongRound {
                    claimed: round,
                    open: other.as_ref().map(Round::number),
                }
                .into())
            }
        };
        self.active(node)?;
        Ok(open)
    }

    fn commit(&self, node: &NodeId) -> Result<(&Round, &Commit), Refusal> {
        self.round
            .as_ref()
            .and_then(|round| Some((round, round.commits.get(node)?)))
            .ok_or(RefusalCode::NotCommitted(*node).into())
    }
}

/// The randomness of a round, without which nobody can make a claim.
pub(crate) fn drawn(round: &Round) -> Result<&Randomness, Refusal> {
    let round_number = round.number();
    let missing = RefusalCode::NoRandomness {
        round: round_number,
    };
    round.randomness.as_ref().ok_or(missing.into())
}

pub(crate) fn already_submitted(claim: &Claim) -> Refusal {
    let code = RefusalCode::Duplicate {
        node: claim.terms.node,
        round: claim.terms.round,
        what: RoundStatement::Claim,
    };
    code.into()
}

/// Refuses something that is recorded after its deadline.
pub(crate) fn in_time(
    what: RoundStatement,
    round: &Round,
    time_ms: u64,
    deadline_ms: u64,
) -> Result<(), Refusal> {
    match time_ms.saturating_sub(deadline_ms) {
        0 => Ok(()),
        late_ms => Err(RefusalCode::Late {
            what,
            round: round.number(),
            late_ms,
        }
        .into()),
    }
}

pub(crate) fn same<T: PartialEq + Display>(
    field: ClaimField,
    claimed: T,
    expected: T,
) -> Result<(), Refusal> {
    if claimed == expected {
        Ok(())
    } else {
        Err(differs(field, claimed, expected))
    }
}

fn differs(field: ClaimField, claimed: impl Display, expected: impl Display) -> Refusal {
    let detail = format_args!("it is {claimed}, but {expected} on the ledger").to_string();
    RefusalCode::Binding(field).because(detail)
}
