//! A small network to test with: fixed keys, a genesis, and builders for each kind of entry.
#![allow(dead_code)]

pub mod log;
pub mod votes;

use ed25519_dalek::SigningKey;
use zk0_circuits::{
    Claim, DatasetCommitment, Digest, Disclosure, Losses, Mode, NodeId, WeightsDigest,
};
use zk0_protocol::entries::entry::{Contributor, RoundClosed, RoundOpened, ENTRY_VERSION};
use zk0_protocol::entries::member::NodeEnrolled;
use zk0_protocol::entries::signed::{DatasetRegistration, Submission, UpdateCommitment};
use zk0_protocol::rules::governance::{Governance, Governor};
use zk0_protocol::rules::network_rules::CreditRule;
use zk0_protocol::{Body, Entry, Genesis, Refusal, RuleViolation, Rules, Signed, State};

pub const T0: u64 = 1_700_000_000_000;
pub const COMMIT_WINDOW: u64 = 1_000;
pub const SUBMIT_WINDOW: u64 = 5_000;
pub const DISPUTE_WINDOW: u64 = 100_000;
pub const VOTING: u64 = 20_000;
pub const TIME_LOCK: u64 = 10_000;

pub fn digest(byte: u8) -> Digest {
    Digest([byte; 32])
}

pub fn weights(byte: u8) -> WeightsDigest {
    WeightsDigest {
        blob: digest(byte),
        quantised: digest(byte ^ 0x80),
    }
}

pub fn log_key() -> SigningKey {
    SigningKey::from_bytes(&[7; 32])
}

pub fn key(node: u8) -> SigningKey {
    SigningKey::from_bytes(&[100 + node; 32])
}

pub fn id(node: u8) -> NodeId {
    NodeId(key(node).verifying_key().to_bytes())
}

/// The keys of three governors, with weights 5, 3 and 2.
pub fn governor_key(governor: u8) -> SigningKey {
    SigningKey::from_bytes(&[200 + governor; 32])
}

pub fn governor(governor: u8) -> NodeId {
    NodeId(governor_key(governor).verifying_key().to_bytes())
}

fn governors() -> Vec<Governor> {
    let mut governors: Vec<_> = [5, 3, 2]
        .into_iter()
        .zip(0..)
        .map(|(weight, number)| Governor {
            key: governor(number),
            name: format!("governor {number}"),
            weight,
        })
        .collect();
    governors.sort_by_key(|governor| governor.key);
    governors
}

pub fn genesis() -> Genesis {
    Genesis {
        name: "zk0.example/test".into(),
        log_key: log_key().verifying_key().to_bytes(),
        nonce: [9; 32],
        rules: Rules {
            min_dataset_samples: 10,
            eval_samples: 2,
            min_improvement_bps: 50,
            max_weight_samples: 100,
            commit_window_ms: COMMIT_WINDOW,
            submit_window_ms: SUBMIT_WINDOW,
            credits: CreditRule {
                bps_samples_per_credit: 100,
                max_per_contribution: 500,
                dispute_window_ms: DISPUTE_WINDOW,
            },
            governance: Governance {
                governors: governors(),
                credits_per_vote: 10,
                max_node_votes: 5,
                quorum_bps: 4000,
                threshold_bps: 5000,
                veto_bps: 3000,
                voting_ms: VOTING,
                time_lock_ms: TIME_LOCK,
            },
            ..Rules::default()
        },
        program: vec![1; 32],
        mode: Mode::Direct,
        evaluation: hex::decode(include_str!("../vectors/evaluation.hex").trim_end()).unwrap(),
        policy: digest(3),
        initial: weights(4),
    }
}

pub fn entry(time_ms: u64, body: Body) -> Entry {
    Entry {
        version: ENTRY_VERSION,
        time_ms,
        body,
    }
}

pub fn enrolled(node: u8) -> Body {
    Body::NodeEnrolled(NodeEnrolled {
        node: id(node),
        name: format!("robot {node}"),
    })
}

/// Registers node `node`'s dataset, which has `10·(node+1)` samples.
pub fn dataset(node: u8) -> DatasetCommitment {
    DatasetCommitment {
        root: digest(0x20 + node),
        samples: 10 * (u64::from(node) + 1),
        feature_spec: digest(5),
        salt_commitment: digest(0x40 + node),
    }
}

pub fn registration(network: &Digest, node: u8) -> DatasetRegistration {
    DatasetRegistration {
        network: *network,
        node: id(node),
        dataset: dataset(node),
        leaves: digest(0x60 + node),
        episodes: vec![digest(0x80 + node), digest(0xc0 + node)],
    }
}

pub fn registered(network: &Digest, node: u8) -> Body {
    Body::DatasetCommitted(Signed::new(registration(network, node), &key(node)))
}

pub fn commitment(state: &State, node: u8, update: WeightsDigest) -> UpdateCommitment {
    UpdateCommitment {
        network: *state.network(),
        round: state.next_round().saturating_sub(1),
        node: id(node),
        dataset_root: dataset(node).root,
        update,
    }
}

pub fn committed(state: &State, node: u8, update: WeightsDigest) -> Body {
    Body::UpdateCommitted(Signed::new(commitment(state, node, update), &key(node)))
}

/// The claim of `node` that the ledger expects.
pub fn claim(state: &State, node: u8) -> Claim {
    let expected = state.expected_claim(&id(node)).expect("a committed node");
    expected.with(match expected.disclosure {
        Disclosure::Nothing => Losses::Hidden,
        Disclosure::Losses => Losses::Disclosed {
            before: 1000,
            after: 900,
            elements: 600,
        },
    })
}

/// `claim`, signed by the node `by`.
pub fn submission(claim: Claim, by: u8) -> Signed<Submission> {
    let proof = digest(0xaa);
    Signed::new(Submission { claim, proof }, &key(by))
}

pub fn accepted(state: &State, node: u8) -> Body {
    Body::ContributionAccepted(submission(claim(state, node), node))
}

pub fn rejected(state: &State, node: u8, reason: Refusal) -> Body {
    Body::ContributionRejected {
        submission: submission(claim(state, node), node),
        reason,
    }
}

pub fn invalid_proof() -> Refusal {
    Refusal::InvalidProof("it does not verify".into())
}

pub fn opened(state: &State, time_ms: u64) -> RoundOpened {
    state.next_opening(time_ms).expect("deadlines fit")
}

pub fn closed(state: &State, global: WeightsDigest) -> RoundClosed {
    RoundClosed {
        round: state.next_round().saturating_sub(1),
        global,
        contributors: state.contributors(),
    }
}

pub fn contributor(node: u8, samples: u64) -> Contributor {
    Contributor {
        node: id(node),
        samples,
        // A fall of the loss from 1000 to 900 is an improvement of 1000 basis points.
        credits: (10 * samples).min(500),
    }
}

/// A state that applies entries one after the other, with a made-up root for each.
pub struct Chain {
    pub state: State,
    pub time_ms: u64,
}

impl Chain {
    pub fn new() -> Self {
        Self::founded(genesis())
    }

    pub fn founded(genesis: Genesis) -> Self {
        let state = State::found(&entry(T0, Body::Genesis(genesis))).expect("a valid genesis");
        Self { state, time_ms: T0 }
    }

    /// Applies `body` one millisecond later.
    pub fn try_apply(&mut self, body: Body) -> Result<(), RuleViolation> {
        self.time_ms += 1;
        let root = digest(self.state.entries() as u8);
        self.state.apply(&root, &entry(self.time_ms, body))
    }

    pub fn apply(&mut self, body: Body) {
        self.try_apply(body).expect("an entry the rules allow");
    }

    /// Returns the violation that `body` causes, and checks that the state has not changed.
    pub fn refusal(&mut self, body: Body) -> RuleViolation {
        let before = self.state.clone();
        let violation = self
            .try_apply(body)
            .expect_err("the rules refuse this entry");
        assert_eq!(before, self.state, "a refused entry changed the state");
        violation
    }

    pub fn open(&mut self) {
        let opened = opened(&self.state, self.time_ms + 1);
        self.apply(Body::RoundOpened(opened));
    }

    /// Makes a network of `nodes` nodes with datasets, with round 0 open.
    pub fn in_round(nodes: u8) -> Self {
        let mut chain = Self::new();
        for node in 0..nodes {
            chain.apply(enrolled(node));
            chain.apply(registered(&chain.state.network().clone(), node));
        }
        chain.open();
        chain
    }

    /// Makes a network of `nodes` nodes, with round 0 open and all updates committed.
    pub fn all_committed(nodes: u8) -> Self {
        let mut chain = Self::in_round(nodes);
        for node in 0..nodes {
            chain.apply(committed(&chain.state, node, weights(0x10 + node)));
        }
        chain
    }
}
