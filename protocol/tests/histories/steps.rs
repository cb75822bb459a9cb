//! The steps of histories. The rules allow most of them; the others are nonsense of all kinds.

use super::bent::bent;
use super::nonsense::nonsense;
use ed25519_dalek::SigningKey;
use proptest::prelude::*;
use std::sync::LazyLock;
use zk0_circuits::{Disclosure, Losses, NodeId};
use zk0_protocol::entries::entry::{DisputeResolved, LostContribution, ProposalSettled};
use zk0_protocol::entries::member::NodeEnrolled;
use zk0_protocol::entries::member::Standing;
use zk0_protocol::entries::program::Program;
use zk0_protocol::entries::proposal::{Action, Ballot, Outcome};
use zk0_protocol::entries::signed::{
    Dispute, Evidence, KeyRotation, KeyTakeover, Proposal, SignableStatement, Submission, Vote,
};
use zk0_protocol::rules::closing::shares::Shares;
use zk0_protocol::rules::network_rules::{EnrolmentRule, Participation};
use zk0_protocol::rules::state::Node;
use zk0_protocol::{Body, Entry, RefusalCode, Rules, Signed, State};
use zk0_testkit::network::*;

/// The keys that join, the keys that take their places, and the governors' keys.
static KEYS: LazyLock<Vec<(NodeId, SigningKey)>> = LazyLock::new(|| {
    let keys = (0..SPARE.end).map(key).chain((0..3).map(governor_key));
    let named = |key: SigningKey| (NodeId(key.verifying_key().to_bytes()), key);
    keys.map(named).collect()
});
const JOINING: u8 = 6;
const SPARE: std::ops::Range<u8> = JOINING..48;

pub fn key_of(id: &NodeId) -> Option<&'static SigningKey> {
    KEYS.iter()
        .find(|(known, _)| known == id)
        .map(|(_, key)| key)
}

/// The numbers choose among the members for whom the step makes sense.
#[derive(Clone, Debug)]
pub enum Step {
    Enrol(u8),
    Register(u8, u8),
    Rotate(u8, u8),
    Open,
    Commit(u8, u8),
    CloseCommitments,
    Draw,
    Accept(u8, u8),
    Reject(u8),
    Lose(u8, bool),
    Move,
    Close(u8),
    Propose(u8, u8, u8),
    Vote(u8, u8, Ballot),
    Settle(u8),
    Dispute(u8, u8, bool),
    Resolve(u8, bool),
    Wait(u32),
    /// The same entry with one byte changed, and signed again.
    Bend(Box<Step>, u16, u8),
    Nonsense(Box<Entry>),
}

fn sensible() -> impl Strategy<Value = Step> {
    let two = || (any::<u8>(), any::<u8>());
    let ballot = prop_oneof![
        8 => Just(Ballot::For),
        1 => Just(Ballot::Against),
        1 => Just(Ballot::Abstain),
        2 => Just(Ballot::Veto),
    ];
    prop_oneof![
        16 => any::<u8>().prop_map(Step::Enrol),
        20 => two().prop_map(|(by, set)| Step::Register(by, set)),
        4 => two().prop_map(|(by, with)| Step::Rotate(by, with)),
        20 => Just(Step::Open),
        40 => two().prop_map(|(by, update)| Step::Commit(by, update)),
        24 => Just(Step::CloseCommitments),
        24 => Just(Step::Draw),
        32 => two().prop_map(|(by, gain)| Step::Accept(by, gain)),
        4 => any::<u8>().prop_map(Step::Reject),
        12 => (any::<u8>(), any::<bool>()).prop_map(|(by, out)| Step::Lose(by, out)),
        3 => Just(Step::Move),
        12 => any::<u8>().prop_map(Step::Close),
        16 => (any::<u8>(), 0..21u8, any::<u8>()).prop_map(|(by, what, whom)| Step::Propose(by, what, whom)),
        80 => (any::<u8>(), 0..6u8, ballot).prop_map(|(by, which, ballot)| Step::Vote(by, which, ballot)),
        20 => any::<u8>().prop_map(Step::Settle),
        16 => (any::<u8>(), any::<u8>(), any::<bool>()).prop_map(|(by, which, document)| Step::Dispute(by, which, document)),
        12 => (any::<u8>(), prop::bool::weighted(0.2)).prop_map(|(which, upheld)| Step::Resolve(which, upheld)),
        // Many steps happen close together, and then nothing happens for a long time.
        6 => (0..1500u32).prop_map(Step::Wait),
        16 => (6_000..25_000u32).prop_map(Step::Wait),
        2 => (60_000..110_000u32).prop_map(Step::Wait),
    ]
}

pub fn step() -> impl Strategy<Value = Step> {
    let bend = (sensible(), any::<u16>(), 1..=255u8);
    prop_oneof![
        20 => sensible(),
        2 => bend.prop_map(|(step, at, with)| Step::Bend(Box::new(step), at, with)),
        1 => nonsense().prop_map(|entry| Step::Nonsense(Box::new(entry))),
    ]
}

/// Usually returns one of those for whom the step makes sense, and rarely somebody else.
fn pick(by: u8, sensible: impl IntoIterator<Item = NodeId>) -> NodeId {
    let sensible: Vec<_> = sensible.into_iter().collect();
    let by = usize::from(by);
    match sensible.is_empty() || by >= 240 {
        true => KEYS[by % KEYS.len()].0,
        false => sensible[by % sensible.len()],
    }
}

fn nth(list: impl IntoIterator<Item = u64>, which: u8) -> u64 {
    let list: Vec<_> = list.into_iter().collect();
    let which = usize::from(which);
    list.get(which % list.len().max(1))
        .copied()
        .unwrap_or(which as u64)
}

/// Returns the enrolment of one of a few nodes. Rarely, its key belongs to somebody else.
fn joining(by: u8) -> NodeEnrolled {
    let node = match by {
        240.. => KEYS[usize::from(by) % KEYS.len()].0,
        _ => id(by % JOINING),
    };
    NodeEnrolled {
        node,
        name: format!("robot {by}"),
    }
}

fn spare(which: u8) -> NodeId {
    let spare = SPARE.start + which % (SPARE.end - SPARE.start);
    KEYS[usize::from(spare)].0
}

fn standing(state: &State, wanted: &[Standing]) -> Vec<NodeId> {
    let stands = |(_, node): &(&NodeId, &Node)| wanted.contains(&node.standing);
    state
        .nodes()
        .iter()
        .filter(stands)
        .map(|(id, _)| *id)
        .collect()
}

/// Signs with the key of the signer that the statement names. If nobody has that key, signs with another one.
pub fn sign<T: SignableStatement>(statement: T) -> Signed<T> {
    let key = key_of(&statement.signer()).unwrap_or(&KEYS[0].1);
    Signed::new(statement, key)
}

/// How long a step waits. Long waits are for votes. While a round is open, most long waits become short, so that the round goes on
/// first.
pub fn wait(step: &Step, state: &State) -> u64 {
    match step {
        Step::Wait(ms) if *ms > 6_000 && ms % 4 > 0 && state.round().is_some() => 1,
        Step::Wait(ms) => u64::from(*ms),
        _ => 1,
    }
}

/// Returns the entry that a step stands for in the present state, or `None` if it makes no sense to build one.
pub fn attempt(step: &Step, state: &State, now: u64) -> Option<Entry> {
    let body = match step {
        Step::Wait(_) => return None,
        Step::Nonsense(entry) => return Some((**entry).clone()),
        Step::Bend(step, at, with) => bent(attempt(step, state, now)?.body, *at, *with),
        Step::Enrol(by) => Body::NodeEnrolled(joining(*by)),
        Step::Register(..) | Step::Rotate(..) => member(step, state)?,
        Step::Propose(..) | Step::Vote(..) | Step::Settle(_) => vote(step, state, now)?,
        Step::Dispute(..) | Step::Resolve(..) => dispute(step, state)?,
        _ => round(step, state, now)?,
    };
    Some(entry(now, body))
}

fn member(step: &Step, state: &State) -> Option<Body> {
    let network = *state.network();
    let active = standing(state, &[Standing::Active]);
    Some(match step {
        Step::Register(by, set) => {
            let node = pick(*by, active);
            // Each key has its own data. A node that has data usually registers the same data again.
            let own = KEYS.iter().position(|(known, _)| *known == node)? as u8;
            let number = if *set >= 240 { *set } else { own };
            let mut registration = registration(&network, number % SPARE.end);
            registration.node = node;
            match state.node(&node).and_then(|node| node.dataset) {
                Some(held) if *set < 200 => registration.dataset = held.commitment,
                _ => {}
            }
            Body::DatasetCommitted(sign(registration))
        }
        Step::Rotate(by, with) => {
            let committed = |node: &NodeId| {
                state
                    .round()
                    .is_some_and(|round| round.commits.contains_key(node))
            };
            let rotation = KeyRotation {
                network,
                node: pick(*by, active.into_iter().filter(|node| !committed(node))),
                with: pick(*with, SPARE.map(|key| KEYS[usize::from(key)].0)),
            };
            Body::KeyRotated {
                rotation: sign(rotation),
                takeover: sign(KeyTakeover { rotation }),
            }
        }
        _ => return None,
    })
}

fn round(step: &Step, state: &State, now: u64) -> Option<Body> {
    let commits = state.round().map(|round| &round.commits);
    let submission = |by: u8, gain: u8| {
        let open = commits
            .into_iter()
            .flatten()
            .filter(|(_, commit)| commit.decision.is_none());
        let expected = state
            .expected_claim(&pick(by, open.map(|(node, _)| *node)))
            .ok()?;
        let claim = expected.with(match expected.disclosure {
            Disclosure::Nothing => Losses::Hidden,
            Disclosure::Losses => Losses::Disclosed {
                before: 1000,
                after: 990 - 3 * u64::from(gain),
                elements: 600,
            },
        });
        let proof = digest(0xaa);
        Some(Submission { claim, proof })
    };
    Some(match step {
        Step::Open => Body::RoundOpened(state.next_opening(now).ok()?),
        Step::Commit(by, update) => {
            let invited = |node: &NodeId| {
                let may = state
                    .round()
                    .is_some_and(|round| state.may_contribute(round, node));
                may && commits.is_some_and(|commits| !commits.contains_key(node))
            };
            let mut commitment = commitment(state, 0, weights(*update));
            commitment.node = pick(*by, state.nodes().keys().copied().filter(invited));
            if let Some(held) = state.node(&commitment.node).and_then(|node| node.dataset) {
                commitment.dataset_root = held.commitment.root;
            }
            Body::UpdateCommitted(sign(commitment))
        }
        Step::CloseCommitments => {
            state.round()?;
            Body::CommitmentsClosed(commitments_closed(state))
        }
        Step::Draw => {
            state.round()?;
            Body::RandomnessDrawn(drawn(state))
        }
        Step::Accept(by, gain) => Body::ContributionAccepted(sign(submission(*by, *gain)?)),
        Step::Reject(by) => {
            let submission = submission(*by, 0)?;
            let reason = match state.check_claim(&submission.claim, now) {
                Err(refusal) if matches!(refusal.code, RefusalCode::Late { .. }) => refusal.code,
                _ => invalid_proof(),
            };
            Body::ContributionRejected {
                submission: sign(submission),
                reason,
            }
        }
        Step::Lose(by, out) => {
            let contributors = state.contributors();
            let lost = LostContribution {
                round: state.round()?.number(),
                node: pick(*by, contributors.iter().map(|one| one.node)),
            };
            if *out {
                Body::ContributionLeftOut(lost)
            } else {
                Body::FilesLost(lost)
            }
        }
        Step::Move => Body::DeadlinesMoved(state.next_move(now, u64::MAX)?),
        Step::Close(global) => {
            let (evaluated, contributed) = (
                state.rules().public_samples.is_some(),
                !state.contributors().is_empty(),
            );
            Body::RoundClosed(match contributed {
                true if evaluated && global % 2 == 0 => kept(state, weights(*global)),
                true => closed(state, weights(*global)),
                false => closed(state, *state.global()),
            })
        }
        _ => return None,
    })
}

fn vote(step: &Step, state: &State, now: u64) -> Option<Body> {
    let open = state.proposals();
    Some(match step {
        Step::Propose(by, what, whom) => {
            let free = |voter: &NodeId| open.values().all(|open| open.proposer != *voter);
            Body::Proposed(sign(Proposal {
                network: *state.network(),
                number: state.next_proposal(),
                proposer: pick(*by, state.electorate().into_keys().filter(free)),
                title: "a better network".into(),
                text: "because".into(),
                action: action(*what, *whom, state),
            }))
        }
        Step::Vote(by, which, ballot) => {
            let proposal = nth(open.keys().copied(), *which);
            let electorate = open.get(&proposal).into_iter().flat_map(|open| {
                let voted = |voter: &NodeId| match ballot {
                    Ballot::Veto => open.vetoes.contains(voter),
                    _ => open.votes.contains_key(voter),
                };
                open.electorate
                    .keys()
                    .copied()
                    .filter(move |voter| !voted(voter))
            });
            Body::Voted(sign(Vote {
                network: *state.network(),
                proposal,
                of: votes::digest_of(state, proposal),
                voter: pick(*by, electorate),
                ballot: *ballot,
            }))
        }
        Step::Settle(which) => {
            let proposal = state.due(now).unwrap_or(nth(open.keys().copied(), *which));
            let outcome = state.outcome(proposal, now).unwrap_or(Outcome::Executed);
            Body::ProposalSettled(ProposalSettled { proposal, outcome })
        }
        _ => return None,
    })
}

fn action(what: u8, whom: u8, state: &State) -> Action {
    let of = |wanted: &[Standing]| pick(whom, standing(state, wanted));
    match what {
        0..=2 => Action::ChangeRules(Box::new(other_rules(whom, state))),
        3 => Action::Enrol(NodeEnrolled {
            node: spare(whom),
            name: "robot".into(),
        }),
        4 => Action::Suspend(of(&[Standing::Active])),
        5..=9 => Action::Reinstate(of(&[Standing::Suspended])),
        10 => Action::Revoke(of(&[Standing::Active, Standing::Suspended])),
        11 => Action::ReplaceKey {
            node: of(&[Standing::Active, Standing::Suspended]),
            with: spare(whom),
        },
        12..=13 => Action::ReplaceProgram(Program {
            // Some keys are too short, and some names are not an SP1 release's.
            key: vec![whom % 100; 32 - usize::from(whom % 8 == 7)],
            sp1: ["6.10.0", "6.11.0-rc1", "7.0.0", ""][usize::from(whom % 4)].into(),
        }),
        14..=16 => Action::RestoreWeights {
            round: u64::from(whom) % (state.next_round() + 1),
        },
        _ => {
            let by_vote = state
                .disputes()
                .iter()
                .filter(|(_, open)| open.evidence != Evidence::Verification);
            Action::JudgeDispute {
                dispute: nth(by_vote.map(|(entry, _)| *entry), whom),
                upheld: whom.is_multiple_of(2),
            }
        }
    }
}

fn other_rules(how: u8, state: &State) -> Rules {
    let mut rules = state.rules().clone();
    let small = how / 16;
    match how % 7 {
        0 => rules.min_eval_samples = small.into(),
        1..=2 => {
            rules.participation = match small {
                0..=3 => Participation::All,
                4..=9 => Participation::Listed(standing(state, &[Standing::Active])),
                _ => Participation::Sampled {
                    nodes: u32::from(small) - 9,
                },
            }
        }
        3 => rules.governance.credits_per_vote = small.into(),
        6 => {
            rules.public_samples = (!small.is_multiple_of(4)).then_some(PUBLIC_SAMPLES);
            rules.shares = match small {
                0..=7 => Shares::Equal,
                _ => Shares::Samples {
                    max_of_median_bps: 2_000 * u32::from(small),
                },
            };
        }
        4 => {
            rules.min_dataset_samples = 2 + 2 * u64::from(small);
            rules.disclosure = match small % 2 {
                0 => Disclosure::Losses,
                _ => Disclosure::Nothing,
            };
        }
        _ => {
            rules.credits.dispute_window_ms = 10_000 * u64::from(small);
            rules.enrolment = match small {
                0..=3 => EnrolmentRule::Vote,
                _ => EnrolmentRule::Operator,
            };
        }
    }
    rules
}

fn dispute(step: &Step, state: &State) -> Option<Body> {
    let open = state.disputes();
    Some(match step {
        Step::Dispute(by, which, document) => {
            let free = |member: &NodeId| open.values().all(|open| open.disputer != *member);
            let governors = state
                .rules()
                .governance
                .governors
                .iter()
                .map(|governor| governor.key);
            let members = standing(state, &[Standing::Active])
                .into_iter()
                .chain(governors);
            Body::Disputed(sign(Dispute {
                network: *state.network(),
                disputer: pick(*by, members.filter(free)),
                contribution: nth(state.contributions().keys().copied(), *which),
                evidence: match document {
                    true => Evidence::Document(digest(*which)),
                    false => Evidence::Verification,
                },
            }))
        }
        Step::Resolve(which, upheld) => {
            let verified = open
                .iter()
                .filter(|(_, open)| open.evidence == Evidence::Verification);
            Body::DisputeResolved(DisputeResolved {
                dispute: nth(verified.map(|(entry, _)| *entry), *which),
                upheld: upheld.then(invalid_proof),
            })
        }
        _ => return None,
    })
}
