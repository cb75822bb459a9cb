//! Makes the entries for the model's events.

use super::second::{Change, Event, Invited, Model, Who, IDS};
use ed25519_dalek::SigningKey;
use zk0_circuits::{NodeId, WeightsDigest};
use zk0_protocol::entries::entry::{DisputeResolved, ProposalSettled};
use zk0_protocol::entries::program::Program;
use zk0_protocol::entries::proposal::{Action, Outcome};
use zk0_protocol::entries::signed::{Dispute, KeyRotation, KeyTakeover, Proposal, Vote};
use zk0_protocol::rules::network_rules::Participation;
use zk0_protocol::{Body, Rules, Signed, State};
use zk0_testkit::network::votes::*;
use zk0_testkit::network::*;

fn signer(who: Who) -> (NodeId, SigningKey) {
    match who {
        Who::Governor(number) => (governor(number), governor_key(number)),
        Who::Node(number) => (IDS[usize::from(number)], key(number)),
    }
}

/// Returns the entry that stands for an event in the present state, or `None` if it cannot even be built.
pub fn body(event: &Event, state: &State, model: &Model, now: u64) -> Option<Body> {
    let network = *state.network();
    let id = |key: &u8| IDS[usize::from(*key)];
    let expected = |key: &u8| state.expected_claim(&id(key)).is_ok();
    Some(match event {
        Event::Enrolled(key) => enrolled(*key),
        // A node's data stay the same when its key changes.
        Event::Registered(key) => {
            let mut registration = registration(&network, model.node(*key));
            registration.node = id(key);
            Body::DatasetCommitted(Signed::new(registration, &zk0_testkit::network::key(*key)))
        }
        Event::Rotated(old, new) => {
            let rotation = KeyRotation {
                network,
                node: id(old),
                with: id(new),
            };
            Body::KeyRotated {
                rotation: Signed::new(rotation, &key(*old)),
                takeover: Signed::new(KeyTakeover { rotation }, &key(*new)),
            }
        }
        Event::Opened => Body::RoundOpened(state.next_opening(now).ok()?),
        // Every update differs from all others.
        Event::Committed(key) => {
            let mut update = weights(0);
            update.blob.0[..8].copy_from_slice(&state.entries().to_le_bytes());
            update.quantised.0[..8].copy_from_slice(&state.entries().to_be_bytes());
            let mut commitment = commitment(state, model.node(*key), update);
            commitment.node = id(key);
            Body::UpdateCommitted(Signed::new(commitment, &zk0_testkit::network::key(*key)))
        }
        Event::Shut => {
            state.round()?;
            Body::CommitmentsClosed(commitments_closed(state))
        }
        Event::Drawn => {
            state.round()?;
            Body::RandomnessDrawn(drawn(state))
        }
        Event::Accepted(key) => expected(key).then(|| accepted(state, *key))?,
        Event::Rejected(key) => expected(key).then(|| rejected(state, *key, invalid_proof()))?,
        Event::Closed => Body::RoundClosed(closed(
            state,
            match state.contributors().is_empty() {
                true => *state.global(),
                false => result(model.history.len()),
            },
        )),
        Event::Proposed(by, change) => {
            let (proposer, key) = signer(*by);
            let action = action(change, state);
            let proposal = Proposal {
                proposer,
                ..proposal(state, 0, action)
            };
            Body::Proposed(Signed::new(proposal, &key))
        }
        Event::Voted(by, number, ballot) => {
            let (voter, key) = signer(*by);
            let vote = Vote {
                network,
                proposal: *number as u64,
                of: digest_of(state, *number as u64),
                voter,
                ballot: *ballot,
            };
            Body::Voted(Signed::new(vote, &key))
        }
        Event::Settled(number, outcome) => {
            let number = *number as u64;
            // The model does not know the code, so the state supplies it.
            let outcome = match (outcome, state.outcome(number, now)) {
                (Outcome::Impossible(_), Ok(Outcome::Impossible(why))) => Outcome::Impossible(why),
                (outcome, _) => outcome.clone(),
            };
            Body::ProposalSettled(ProposalSettled {
                proposal: number,
                outcome,
            })
        }
        Event::Disputed(by, contribution, evidence) => {
            let (disputer, key) = signer(*by);
            let dispute = Dispute {
                network,
                disputer,
                contribution: Model::index(*contribution),
                evidence: *evidence,
            };
            Body::Disputed(Signed::new(dispute, &key))
        }
        Event::Resolved(dispute, upheld) => Body::DisputeResolved(DisputeResolved {
            dispute: Model::index(*dispute),
            upheld: upheld.then(invalid_proof),
        }),
    })
}

fn action(change: &Change, state: &State) -> Action {
    let id = |key: &u8| IDS[usize::from(*key)];
    match change {
        Change::Rules(samples, invited) => Action::ChangeRules(Box::new(Rules {
            min_eval_samples: *samples,
            participation: participation(*invited),
            ..state.rules().clone()
        })),
        Change::Enrol(key) => Action::Enrol(enrolment(*key)),
        Change::Suspend(key) => Action::Suspend(id(key)),
        Change::Reinstate(key) => Action::Reinstate(id(key)),
        Change::Revoke(key) => Action::Revoke(id(key)),
        Change::Replace(old, new) => Action::ReplaceKey {
            node: id(old),
            with: id(new),
        },
        Change::Judge(dispute, upheld) => Action::JudgeDispute {
            dispute: Model::index(*dispute),
            upheld: *upheld,
        },
        Change::Program(number) => Action::ReplaceProgram(program(*number)),
        Change::Restore(round) => Action::RestoreWeights {
            round: *round as u64,
        },
    }
}

/// The guest program with this number. The network begins with number 1.
pub fn program(number: u8) -> Program {
    Program::founding(&[number; 32])
}

/// The weights that the round ended with that closed at this place in the history.
pub fn result(closed: usize) -> WeightsDigest {
    let mut weights = weights(0x50);
    weights.blob.0[..8].copy_from_slice(&Model::index(closed).to_le_bytes());
    weights
}

pub fn participation(invited: Invited) -> Participation {
    match invited {
        Invited::All => Participation::All,
        Invited::Listed(one, other) => {
            let mut listed = [one, other].map(|key| IDS[usize::from(key)]);
            listed.sort();
            Participation::Listed(listed.to_vec())
        }
        Invited::Sampled(nodes) => Participation::Sampled { nodes },
    }
}
