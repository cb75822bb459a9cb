//! The fields of a claim that the ledger determines, checked before the proof.

use crate::entries::member::Standing;
use crate::entries::refusal::claim_field::ClaimField;
use crate::entries::refusal::code::{RefusalCode, RoundStatement};
use crate::entries::refusal::Refusal;
use crate::rules::state::{Commit, Randomness, Round, State};
use crate::rules::violation::RuleViolation;
use borsh::{BorshDeserialize, BorshSerialize};
use std::fmt::Display;
use zk0_circuits::claim::challenge::challenge;
use zk0_circuits::{Claim, Digest, Disclosure, Losses, NodeId, Terms, CLAIM_VERSION};

/// The part of a claim that the ledger determines.
#[derive(Clone, Copy, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct ExpectedClaim {
    /// The claim's terms.
    pub terms: Terms,
    /// The required disclosure of the losses.
    pub disclosure: Disclosure,
}

/// The ledger's part of any claim that a node may make now.
#[derive(Clone, Copy, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct ClaimBindings {
    network: Digest,
    node: NodeId,
    /// The open round's number.
    open: Option<u64>,
    /// The node's standing, if enrolled.
    standing: Option<Standing>,
    /// Its commitment in the open round.
    commit: Option<OpenCommit>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
struct OpenCommit {
    /// Whether a claim was accepted or rejected.
    decided: bool,
    /// The claim, and its deadline in Unix milliseconds; `None` before the randomness.
    expected: Option<(ExpectedClaim, u64)>,
}

impl ExpectedClaim {
    /// The claim with these terms and losses, without a weight check.
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
    /// The claim that `node` may make in the open round, by the ledger.
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

    pub(crate) fn claim_bindings(&self, node: &NodeId) -> ClaimBindings {
        let deadline_ms = |round: &Round| Some(round.randomness?.submit_deadline_ms);
        ClaimBindings {
            network: self.network,
            node: *node,
            open: self.round.as_ref().map(Round::number),
            standing: self.nodes.get(node).map(|node| node.standing),
            commit: self.commit(node).ok().map(|(round, commit)| OpenCommit {
                decided: commit.decision.is_some(),
                expected: self.expected_claim(node).ok().zip(deadline_ms(round)),
            }),
        }
    }

    /// Compares a claim recorded at `time_ms` with the ledger: network, round, enrolment, commitment, one submission a round,
    /// each field, and the deadline.
    pub fn check_claim(&self, claim: &Claim, time_ms: u64) -> Result<(), Refusal> {
        let bindings = self.claim_bindings(&claim.terms.node);
        bindings.check_claim(claim, time_ms)
    }

    /// Checks for this network, the open round, and an active node.
    pub(crate) fn check_addressed(
        &self,
        network: &Digest,
        round: u64,
        node: &NodeId,
    ) -> Result<&Round, Refusal> {
        let open = self.round.as_ref().map(|open| (open.number(), open));
        let open = in_open_round((network, round), &self.network, open)?;
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

impl ClaimBindings {
    /// The node's standing, if enrolled and if the bindings are its own.
    pub fn standing(&self, node: &NodeId) -> Option<Standing> {
        self.standing.filter(|_| *node == self.node)
    }

    /// As [`State::check_claim`].
    pub fn check_claim(&self, claim: &Claim, time_ms: u64) -> Result<(), Refusal> {
        self.check_bindings(claim)?;
        match self.commit.and_then(|commit| commit.expected) {
            Some((_, deadline_ms)) => {
                let round = claim.terms.round;
                in_time(RoundStatement::Claim, round, time_ms, deadline_ms)
            }
            None => Ok(()),
        }
    }

    fn check_bindings(&self, claim: &Claim) -> Result<(), Refusal> {
        same(ClaimField::Version, claim.version, CLAIM_VERSION)?;
        let expected = self.answered(claim)?;
        claim
            .check(&expected.terms, expected.disclosure)
            .map_err(|wrong| {
                let field = ClaimField::named(wrong.term).unwrap_or(ClaimField::Version);
                differs(field, wrong.claimed, wrong.expected)
            })
    }

    /// The expected claim, if the node may make one now.
    fn answered(&self, claim: &Claim) -> Result<ExpectedClaim, Refusal> {
        let Terms {
            network,
            round,
            node,
            ..
        } = &claim.terms;
        let open = self.open.map(|number| (number, number));
        let round = in_open_round((network, *round), &self.network, open)?;
        active(node, self.standing(node).map(|standing| (standing, ())))?;
        let commit = self.commit.ok_or(RefusalCode::NotCommitted(*node))?;
        if commit.decided {
            return Err(RefusalCode::Duplicate {
                node: *node,
                round,
                what: RoundStatement::Claim,
            }
            .into());
        }
        match commit.expected {
            Some((expected, _)) => Ok(expected),
            None => Err(RefusalCode::NoRandomness { round }.into()),
        }
    }

    /// Whether a refusal of a claim may be recorded at `time_ms` for this reason: once, about the open round, of a node that
    /// committed, and with the reason that the ledger shows, if any.
    pub fn check_rejected(
        &self,
        claim: &Claim,
        reason: &RefusalCode,
        time_ms: u64,
    ) -> Result<(), RuleViolation> {
        // A stranger may resend what the node signed for another round.
        self.answered(claim).map(drop)?;
        let found = self.check_claim(claim, time_ms);
        let code = found.as_ref().map_err(|refusal| refusal.code);
        let holds = match (reason, &code) {
            (
                RefusalCode::Late {
                    what,
                    round,
                    late_ms,
                },
                Err(RefusalCode::Late {
                    what: late,
                    round: open,
                    late_ms: at_most,
                }),
            ) => {
                // It was refused on arrival, and recorded later.
                (1..=*at_most).contains(late_ms) && round == open && what == late
            }
            (reason, found) if reason.follows_from_ledger() => found.as_ref() == Err(reason),
            (reason, _) if !reason.follows_from_blobs() => false,
            // The proof and the blobs show these reasons.
            _ => true,
        };
        if holds {
            Ok(())
        } else {
            Err(RuleViolation::WrongReason {
                given: reason.to_string(),
                found: match found {
                    Ok(()) => "by the ledger nothing is wrong with the claim".into(),
                    Err(found) => format!("by the ledger the reason is: {found}"),
                },
            })
        }
    }
}

/// A round's randomness; without it no claim is possible.
fn drawn(round: &Round) -> Result<&Randomness, Refusal> {
    let missing = RefusalCode::NoRandomness {
        round: round.number(),
    };
    round.randomness.as_ref().ok_or(missing.into())
}

/// The open round's part, if network and round are right. `open` has the round's number, too.
fn in_open_round<R>(
    (network, round): (&Digest, u64),
    ours: &Digest,
    open: Option<(u64, R)>,
) -> Result<R, Refusal> {
    if network != ours {
        return Err(RefusalCode::WrongNetwork {
            claimed: *network,
            ours: *ours,
        }
        .into());
    }
    match open {
        Some((number, open)) if number == round => Ok(open),
        other => Err(RefusalCode::WrongRound {
            claimed: round,
            open: other.map(|(number, _)| number),
        }
        .into()),
    }
}

pub(crate) fn active<N>(id: &NodeId, found: Option<(Standing, N)>) -> Result<N, Refusal> {
    match found {
        None => Err(RefusalCode::NotEnrolled(*id).into()),
        Some((Standing::Active, node)) => Ok(node),
        Some((standing, _)) => Err(RefusalCode::NotActive {
            node: *id,
            standing,
        }
        .into()),
    }
}

pub(crate) fn in_time(
    what: RoundStatement,
    round: u64,
    time_ms: u64,
    deadline_ms: u64,
) -> Result<(), Refusal> {
    match time_ms.saturating_sub(deadline_ms) {
        0 => Ok(()),
        late_ms => Err(RefusalCode::Late {
            what,
            round,
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
