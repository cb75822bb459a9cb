//! A network of any size, founded as the protocol's test network. Its nodes commit and submit round after round, and every statement
//! is signed.

use anyhow::{Context, Result};
use ed25519_dalek::SigningKey;
use rayon::prelude::*;
use std::path::Path;
use zk0_circuits::{Claim, DatasetCommitment, Digest, Losses, NodeId, WeightsDigest};
use zk0_ledger::group::WantedEntry;
use zk0_ledger::Ledger;
use zk0_protocol::challenge::closing::commitments;
use zk0_protocol::entries::authentic::AuthenticBody;
use zk0_protocol::entries::entry::{CommitmentsClosed, RoundClosed, RoundOpened};
use zk0_protocol::entries::member::NodeEnrolled;
use zk0_protocol::entries::signed::{
    DatasetRegistration, RegisteredEpisode, Submission, UpdateCommitment,
};
use zk0_protocol::{Body, RuleViolation, Signed, State};
use zk0_testkit::network::{
    closed, commitments_closed, drawn, genesis, invalid_proof, log_key, opened, T0,
};

/// How many nodes the network of most figures has.
pub const NODES: u64 = 250;

/// When the network begins, in Unix milliseconds.
pub const TIME: u64 = T0;

/// Returns a digest that belongs to this number only.
fn digest(what: u64, number: u64) -> Digest {
    let mut bytes = [0; 32];
    bytes[..8].copy_from_slice(&what.to_be_bytes());
    bytes[8..16].copy_from_slice(&number.to_be_bytes());
    Digest(bytes)
}

fn key(number: u64) -> SigningKey {
    SigningKey::from_bytes(&digest(1, number).0)
}

fn id(key: &SigningKey) -> NodeId {
    NodeId(key.verifying_key().to_bytes())
}

fn weights(number: u64) -> WeightsDigest {
    WeightsDigest {
        blob: digest(2, number),
        quantised: digest(3, number),
    }
}

/// A ledger with nothing but its genesis.
pub fn founded(dir: &Path) -> Result<Ledger> {
    let mut genesis = genesis();
    genesis.rules.credits.dispute_window_ms = 1000;
    // Some nodes are refused in each round.
    genesis.rules.unanswered.max = genesis.rules.unanswered.of_last;
    let (ledger, _) = Ledger::create(dir, genesis, log_key(), TIME)?;
    Ok(ledger)
}

/// Returns the enrolments of the nodes with these numbers. Only the log signs these entries.
pub fn enrolments(numbers: std::ops::Range<u64>) -> Vec<Body> {
    let enrol = |number| {
        Body::NodeEnrolled(NodeEnrolled {
            node: id(&key(number)),
            name: format!("robot {number}"),
        })
    };
    numbers.into_par_iter().map(enrol).collect()
}

/// Returns the entries of rounds that open and close without contributors. Each round has three entries, and only the log signs them.
pub fn empty_rounds(state: &State, count: u64) -> Vec<Body> {
    let first = opened(state, TIME);
    let rounds = first.round..first.round + count;
    rounds
        .flat_map(|round| {
            let opened = RoundOpened {
                round,
                ..first.clone()
            };
            let nobody = std::iter::empty();
            let commitments = CommitmentsClosed {
                round,
                commitments: commitments(state.network(), round, nobody),
            };
            let closed = RoundClosed {
                round,
                global: first.base,
                contributors: Vec::new(),
                unanswered: Vec::new(),
                evaluated: None,
            };
            [
                Body::RoundOpened(opened),
                Body::CommitmentsClosed(commitments),
                Body::RoundClosed(closed),
            ]
        })
        .collect()
}

/// Returns the registrations of so many nodes' datasets, `times` over. A node signs each of these entries.
pub fn registrations(state: &State, nodes: u64, times: u64) -> Vec<Body> {
    let network = *state.network();
    let register = |number: u64| {
        let key = key(number % nodes);
        let registration = DatasetRegistration {
            network,
            node: id(&key),
            dataset: dataset(number % nodes),
            leaves: digest(7, number),
            evaluation_frames: state.rules().evaluation_frames,
            episodes: vec![RegisteredEpisode {
                digest: digest(9, number % nodes),
                frames: 400,
            }],
        };
        Body::DatasetCommitted(Signed::new(registration, &key))
    };
    (0..times * nodes).into_par_iter().map(register).collect()
}

fn dataset(node: u64) -> DatasetCommitment {
    DatasetCommitment {
        root: digest(5, node),
        samples: 50,
        feature_spec: digest(6, 0),
        salt_commitment: digest(6, 1 + node),
    }
}

/// Records entries as one group, and returns their indexes. The rules have to allow all of them.
pub fn record(ledger: &mut Ledger, time_ms: u64, bodies: Vec<Body>) -> Result<Vec<u64>> {
    // A service verifies signatures on all cores, before it has its turn.
    let wanted = bodies.into_par_iter().map(|body| {
        let body = AuthenticBody::of(body)?;
        Ok(WantedEntry { time_ms, body })
    });
    let outcomes = ledger.commit(wanted.collect::<Result<_, RuleViolation>>()?)?;
    Ok(outcomes.into_iter().collect::<Result<_, _>>()?)
}

/// Makes a ledger of `entries` entries: of a thousand, about 500 commitments, 450 acceptances and 50 refusals, each of them
/// signed by a node, and two rounds.
pub fn grown(dir: &Path, entries: u64) -> Result<()> {
    let mut ledger = with_nodes(dir, NODES)?;
    grow(&mut ledger, NODES, |ledger| ledger.size() < entries)
}

/// A ledger in which so many nodes have datasets.
pub fn with_nodes(dir: &Path, nodes: u64) -> Result<Ledger> {
    let mut ledger = founded(dir)?;
    record(&mut ledger, TIME, enrolments(0..nodes))?;
    let registrations = registrations(ledger.state(), nodes, 1);
    record(&mut ledger, TIME, registrations)?;
    Ok(ledger)
}

/// Appends rounds of these nodes, as [`grown`] does, while the ledger wants more.
pub fn grow(ledger: &mut Ledger, nodes: u64, more: impl Fn(&Ledger) -> bool) -> Result<()> {
    let keys: Vec<SigningKey> = (0..nodes).map(key).collect();
    while more(ledger) {
        let state = ledger.state();
        // Each round begins so late that the round before it can no longer be disputed.
        let now = TIME + state.next_round() * 2000;
        let opening = opened(state, now);
        let (network, round) = (*state.network(), opening.round);
        let commit = |(node, key): (usize, &SigningKey)| {
            let node = node as u64;
            let commitment = UpdateCommitment {
                network,
                round,
                node: id(key),
                dataset_root: dataset(node).root,
                update: weights(1 + round * nodes + node),
                eval_samples: state.rules().min_eval_samples,
            };
            Body::UpdateCommitted(Signed::new(commitment, key))
        };
        let mut bodies = vec![Body::RoundOpened(opening)];
        bodies.par_extend(keys.par_iter().enumerate().map(commit));
        record(ledger, now, bodies)?;
        let closing = commitments_closed(ledger.state());
        ledger.append(now, Body::CommitmentsClosed(closing))?;
        let drawing = drawn(ledger.state());
        ledger.append(now, Body::RandomnessDrawn(drawing))?;

        let state = ledger.state();
        let decide = |(node, key): (usize, &SigningKey)| {
            let submission = Submission {
                claim: claim(state, &id(key))?,
                proof: digest(8, round * nodes + node as u64),
            };
            let submission = Signed::new(submission, key);
            Ok(match node % 10 {
                0 => Body::ContributionRejected {
                    submission,
                    reason: invalid_proof(),
                },
                _ => Body::ContributionAccepted(submission),
            })
        };
        let decided: Result<Vec<Body>> = keys.par_iter().enumerate().map(decide).collect();
        record(ledger, now, decided?)?;
        let closed = closed(ledger.state(), weights(round));
        ledger.append(now, Body::RoundClosed(closed))?;
        if round % 200 == 199 {
            eprintln!("  {} entries made", ledger.size());
        }
    }
    Ok(())
}

/// The claim that the ledger expects of a node.
fn claim(state: &State, node: &NodeId) -> Result<Claim> {
    let expected = state.expected_claim(node).context("a committed node")?;
    Ok(expected.with(Losses::Disclosed {
        before: 1000,
        after: 900,
        elements: 600,
    }))
}
