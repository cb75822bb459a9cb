//! A small network: fixed keys, a genesis, and each kind of entry.

pub mod beacon;
pub mod log;
pub mod log_keys;
pub mod votes;

use ed25519_dalek::SigningKey;
use zk0_circuits::{
    Claim, DatasetCommitment, Digest, Disclosure, Losses, Mode, NodeId, WeightsDigest,
};
use zk0_protocol::challenge::drawing::Drawing;
use zk0_protocol::challenge::vrf::VrfProof;
use zk0_protocol::entries::entry::{
    CommitmentsClosed, Contributor, RandomnessDrawn, RoundClosed, RoundOpened, ENTRY_VERSION,
};
use zk0_protocol::entries::member::NodeEnrolled;
use zk0_protocol::entries::round_result::{EvaluatedResult, PublicLoss, ResultOutcome};
use zk0_protocol::entries::signed::{
    DatasetRegistration, RegisteredEpisode, Submission, UpdateCommitment,
};
use zk0_protocol::rules::closing::credits::CreditRule;
use zk0_protocol::rules::closing::public_samples::PublicSamples;
use zk0_protocol::rules::closing::shares::WHOLE_SHARE;
use zk0_protocol::rules::governance::{Governance, Governor};
use zk0_protocol::{Body, Entry, Genesis, RefusalCode, RuleViolation, Rules, Signed, State};

/// The founding, in milliseconds since 1970.
pub const T0: u64 = 1_700_000_000_000;
/// Time for commitments; all windows are in milliseconds.
pub const COMMIT_WINDOW: u64 = 1_000;
/// Time for submissions.
pub const SUBMIT_WINDOW: u64 = 5_000;
/// Time for randomness.
pub const RANDOMNESS_WINDOW: u64 = 2_000;
/// Time for disputes.
pub const DISPUTE_WINDOW: u64 = 100_000;
/// Frames of an evaluation set.
pub const EVALUATION_FRAMES: u32 = 300;
/// Time for votes.
pub const VOTING: u64 = 20_000;
/// Delay of decisions.
pub const TIME_LOCK: u64 = 10_000;

const EVALUATION: &str = include_str!(concat!(
    env!("CARGO_MANIFEST_DIR"),
    "/../protocol/tests/vectors/evaluation.hex"
));

/// This byte, repeated.
pub fn digest(byte: u8) -> Digest {
    Digest([byte; 32])
}

/// Digests of this byte.
pub fn weights(byte: u8) -> WeightsDigest {
    WeightsDigest {
        blob: digest(byte),
        quantised: digest(byte ^ 0x80),
    }
}

/// The log's key.
pub fn log_key() -> SigningKey {
    SigningKey::from_bytes(&[7; 32])
}

/// A node's key.
pub fn key(node: u8) -> SigningKey {
    SigningKey::from_bytes(&[100 + node; 32])
}

/// A node's public key.
pub fn id(node: u8) -> NodeId {
    NodeId(key(node).verifying_key().to_bytes())
}

/// Governors, with weights 5, 3 and 2.
pub fn governor_key(governor: u8) -> SigningKey {
    SigningKey::from_bytes(&[200 + governor; 32])
}

/// A governor's public key.
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

/// The network's genesis.
pub fn genesis() -> Genesis {
    Genesis {
        name: "zk0.example/test".into(),
        log_key: log_key().verifying_key().to_bytes(),
        nonce: [9; 32],
        rules: Rules {
            min_dataset_samples: 10,
            min_eval_samples: 2,
            min_improvement_bps: 50,
            commit_window_ms: COMMIT_WINDOW,
            submit_window_ms: SUBMIT_WINDOW,
            evaluation_frames: EVALUATION_FRAMES,
            randomness_window_ms: RANDOMNESS_WINDOW,
            credits: CreditRule {
                bps_per_credit: 10,
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
        evaluation: hex::decode(EVALUATION.trim_end()).unwrap(),
        policy: digest(3),
        initial: weights(4),
    }
}

/// In this version.
pub fn entry(time_ms: u64, body: Body) -> Entry {
    Entry {
        version: ENTRY_VERSION,
        time_ms,
        body,
    }
}

/// Enrols a node.
pub fn enrolled(node: u8) -> Body {
    Body::NodeEnrolled(NodeEnrolled {
        node: id(node),
        name: format!("robot {node}"),
    })
}

/// `10·(node+1)` samples.
pub fn dataset(node: u8) -> DatasetCommitment {
    DatasetCommitment {
        root: digest(0x20 + node),
        samples: 10 * (u64::from(node) + 1),
        feature_spec: digest(5),
        salt_commitment: digest(0x40 + node),
    }
}

/// A node's registration.
pub fn registration(network: &Digest, node: u8) -> DatasetRegistration {
    DatasetRegistration {
        network: *network,
        node: id(node),
        dataset: dataset(node),
        evaluation_frames: EVALUATION_FRAMES,
        leaves: digest(0x60 + node),
        episodes: vec![episode(digest(0x80 + node)), episode(digest(0xc0 + node))],
    }
}

/// An episode of 200 frames.
pub fn episode(digest: Digest) -> RegisteredEpisode {
    let frames = 200;
    RegisteredEpisode { digest, frames }
}

/// The signed registration.
pub fn registered(network: &Digest, node: u8) -> Body {
    Body::DatasetCommitted(Signed::new(registration(network, node), &key(node)))
}

/// A commitment to an update, in the open round.
pub fn commitment(state: &State, node: u8, update: WeightsDigest) -> UpdateCommitment {
    UpdateCommitment {
        network: *state.network(),
        round: state.next_round().saturating_sub(1),
        node: id(node),
        dataset_root: dataset(node).root,
        update,
        eval_samples: state.rules().min_eval_samples,
    }
}

/// The signed commitment.
pub fn committed(state: &State, node: u8, update: WeightsDigest) -> Body {
    Body::UpdateCommitted(Signed::new(commitment(state, node, update), &key(node)))
}

/// The expected claim.
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

/// Signed by node `by`.
pub fn submission(claim: Claim, by: u8) -> Signed<Submission> {
    let proof = digest(0xaa);
    Signed::new(Submission { claim, proof }, &key(by))
}

/// Accepts a contribution.
pub fn accepted(state: &State, node: u8) -> Body {
    Body::ContributionAccepted(submission(claim(state, node), node))
}

/// Rejects a contribution.
pub fn rejected(state: &State, node: u8, reason: RefusalCode) -> Body {
    Body::ContributionRejected {
        submission: submission(claim(state, node), node),
        reason,
    }
}

/// The refusal of a wrong proof.
pub fn invalid_proof() -> RefusalCode {
    RefusalCode::InvalidProof
}

/// The next round's opening.
pub fn opened(state: &State, time_ms: u64) -> RoundOpened {
    state.next_opening(time_ms).expect("deadlines fit")
}

/// Closes with the result `global`, slightly better than the base if the rules ask for an evaluation.
pub fn closed(state: &State, global: WeightsDigest) -> RoundClosed {
    let contributors = state.contributors();
    let samples = state.rules().public_samples;
    let samples = samples.filter(|_| !contributors.is_empty());
    RoundClosed {
        round: state.next_round().saturating_sub(1),
        global,
        contributors,
        unanswered: state.unanswered(),
        evaluated: samples.map(|_| EvaluatedResult {
            weights: global,
            elements: 96,
            base: PublicLoss::SquaredError(1_000_000),
            result: PublicLoss::SquaredError(999_999),
            outcome: ResultOutcome::Taken,
        }),
    }
}

/// Closes the commitments, allowed or not.
pub fn commitments_closed(state: &State) -> CommitmentsClosed {
    let round = state.round().expect("an open round");
    let by_node = round.commits.iter();
    CommitmentsClosed {
        round: round.number(),
        commitments: zk0_protocol::challenge::closing::commitments(
            state.network(),
            round.number(),
            by_node.map(|(node, commit)| (node, &commit.commitment)),
        ),
    }
}

/// Randomness from the log's key.
pub fn drawn(state: &State) -> RandomnessDrawn {
    let round = state.round().expect("an open round");
    let commitments = round.closing.map(|closing| closing.commitments);
    let input = commitments.unwrap_or_default();
    RandomnessDrawn {
        round: round.number(),
        drawing: Drawing::LogVrf(VrfProof::of(&log_key(), &input.0)),
    }
}

/// Closes with an evaluated result that is not taken.
pub fn kept(state: &State, result: WeightsDigest) -> RoundClosed {
    let mut closed = closed(state, result);
    closed.global = state.round().expect("an open round").opened.base;
    closed
        .contributors
        .iter_mut()
        .for_each(|one| one.credits = 0);
    if let Some(evaluated) = &mut closed.evaluated {
        evaluated.result = PublicLoss::Overflow { sample: 3 };
        evaluated.outcome = ResultOutcome::Overflow;
    }
    closed
}

/// For the rules.
pub const PUBLIC_SAMPLES: PublicSamples = PublicSamples {
    blob: Digest([0x77; 32]),
    samples: 8,
    max_loss_increase_bps: 500,
};

/// Records a whole contribution.
pub fn contributor(node: u8) -> Contributor {
    Contributor {
        node: id(node),
        share: WHOLE_SHARE,
        // From 1000 to 900, a loss improves by 1000 basis points.
        credits: 100,
    }
}

/// Applies entries in order, with made-up roots.
#[derive(Clone)]
pub struct Chain {
    /// After the last entry.
    pub state: State,
    /// Of the last entry.
    pub time_ms: u64,
}

impl Default for Chain {
    fn default() -> Self {
        Self::new()
    }
}

impl Chain {
    /// Just founded.
    pub fn new() -> Self {
        Self::founded(genesis())
    }

    /// With this genesis.
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

    /// Applies an allowed entry.
    pub fn apply(&mut self, body: Body) {
        self.try_apply(body).expect("an entry the rules allow");
    }

    /// The violation, which leaves the state as it was.
    pub fn refusal(&mut self, body: Body) -> RuleViolation {
        let before = self.state.clone();
        let violation = self
            .try_apply(body)
            .expect_err("the rules refuse this entry");
        assert_eq!(before, self.state, "a refused entry changed the state");
        violation
    }

    /// Opens the next round.
    pub fn open(&mut self) {
        let opened = opened(&self.state, self.time_ms + 1);
        self.apply(Body::RoundOpened(opened));
    }

    /// Closes the commitments, if needed past their deadline.
    pub fn close_commitments(&mut self) {
        let now = self.time_ms + 1;
        if self.state.next_commitments_closed(now).is_none() {
            let round = self.state.round().expect("an open round");
            self.time_ms = round.opened.commit_deadline_ms;
        }
        self.apply(Body::CommitmentsClosed(commitments_closed(&self.state)));
    }

    /// Closes the commitments and draws the randomness.
    pub fn draw(&mut self) {
        self.close_commitments();
        self.apply(Body::RandomnessDrawn(drawn(&self.state)));
    }

    /// Closes the round, if needed past its deadlines.
    pub fn close(&mut self, global: WeightsDigest) {
        let round = self.state.round().expect("an open round");
        match (round.closing, round.commits.is_empty()) {
            (None, true) => self.close_commitments(),
            (None, false) => self.draw(),
            _ => {}
        }
        let randomness = self.state.round().and_then(|round| round.randomness);
        if let (false, Some(randomness)) = (self.state.may_close(self.time_ms + 1), randomness) {
            self.time_ms = randomness.submit_deadline_ms;
        }
        self.apply(Body::RoundClosed(closed(&self.state, global)));
    }

    /// Nodes with datasets in round 0.
    pub fn in_round(nodes: u8) -> Self {
        let mut chain = Self::new();
        for node in 0..nodes {
            chain.apply(enrolled(node));
            chain.apply(registered(&chain.state.network().clone(), node));
        }
        chain.open();
        chain
    }

    /// [`Self::in_round`] with all commitments and randomness.
    pub fn all_committed(nodes: u8) -> Self {
        let mut chain = Self::in_round(nodes);
        for node in 0..nodes {
            chain.apply(committed(&chain.state, node, weights(0x10 + node)));
        }
        chain.draw();
        chain
    }
}
