//! Ledgers that a test makes without nodes and provers.

use ed25519_dalek::SigningKey;
use std::path::Path;
use zk0_circuits::claim::program::verifying_key;
use zk0_circuits::model::spec::EvalSpec;
use zk0_circuits::{DatasetCommitment, Digest, Losses, Mode, NodeId, WeightsDigest};
use zk0_ledger::Ledger;
use zk0_protocol::challenge::drawing::Drawing;
use zk0_protocol::challenge::unanswered::UnansweredRule;
use zk0_protocol::entries::entry::{RandomnessDrawn, RoundClosed};
use zk0_protocol::entries::member::NodeEnrolled;
use zk0_protocol::entries::signed::{
    DatasetRegistration, RegisteredEpisode, Submission, UpdateCommitment,
};
use zk0_protocol::rules::closing::credits::CreditRule;
use zk0_protocol::{Body, Genesis, RefusalCode, Rules, Signed};

/// A ledger whose entries follow the rules, and whose proofs are not real.
pub struct Made {
    /// The ledger.
    pub ledger: Ledger,
    /// The time of the last entry.
    pub time_ms: u64,
    /// The weights of the updates depend on this number.
    pub seed: u8,
    /// If this holds a text, all nodes but the last are accepted, and the refusal of the last gives the text as its reason.
    /// Otherwise all nodes are refused for the true reason.
    pub lie: Option<RefusalCode>,
}

/// What nodes submit instead of proofs begins with this.
const NO_PROOF: &[u8; 4] = b"none";

/// The names of the nodes. They try to get code into a report.
pub const NAMES: [&str; 3] = [
    "<script>alert(1)</script>",
    "\"><img src=x onerror=alert(1)>",
    "&lt;b&gt; Zoë's arm",
];

impl Made {
    /// A node's key.
    pub fn node(node: u8) -> SigningKey {
        SigningKey::from_bytes(&[100 + node; 32])
    }

    /// A node's identity.
    pub fn id(node: u8) -> NodeId {
        NodeId(Self::node(node).verifying_key().to_bytes())
    }

    /// Founds the ledger, with its nodes and their datasets.
    pub fn found(dir: &Path, seed: u8) -> Self {
        Self::found_with(dir, seed, [9; 32], String::new())
    }

    /// Founds the ledger like [`Self::found`], with this nonce and these witnesses in the rules.
    pub fn found_with(dir: &Path, seed: u8, nonce: [u8; 32], witness_policy: String) -> Self {
        let key = SigningKey::from_bytes(&[7; 32]);
        let genesis = Genesis {
            name: "zk0.example/audit<test>".into(),
            log_key: key.verifying_key().to_bytes(),
            nonce,
            rules: Rules {
                min_dataset_samples: 4,
                min_eval_samples: 2,
                min_improvement_bps: 50,
                commit_window_ms: 1_000,
                submit_window_ms: 5_000,
                credits: CreditRule {
                    bps_per_credit: 100,
                    max_per_contribution: 1000,
                    dispute_window_ms: 1000,
                },
                witness_policy,
                // The nodes of a made ledger may be refused as often as a test likes.
                unanswered: UnansweredRule {
                    max: 1,
                    of_last: 1,
                    pause_rounds: 1,
                },
                ..Rules::default()
            },
            program: verifying_key(Mode::Direct).to_vec(),
            mode: Mode::Direct,
            evaluation: EvalSpec::micro().encode(),
            policy: Digest([3; 32]),
            initial: weights(4, 0),
        };
        let time_ms = 1_700_000_000_000;
        let (ledger, _) = Ledger::create(dir, genesis, key, time_ms).unwrap();
        let mut made = Self {
            ledger,
            time_ms,
            seed,
            lie: None,
        };
        for (node, name) in (0..).zip(NAMES) {
            made.append(Body::NodeEnrolled(NodeEnrolled {
                node: Self::id(node),
                name: name.into(),
            }));
            let registration = DatasetRegistration {
                network: *made.ledger.state().network(),
                node: Self::id(node),
                dataset: DatasetCommitment {
                    root: Digest([0x20 + node; 32]),
                    samples: 10 + u64::from(node),
                    feature_spec: Digest([5; 32]),
                    salt_commitment: Digest([0x40 + node; 32]),
                },
                leaves: Digest([0x60 + node; 32]),
                evaluation_frames: Rules::default().evaluation_frames,
                episodes: vec![RegisteredEpisode {
                    digest: Digest([node; 32]),
                    frames: 100,
                }],
            };
            made.append(Body::DatasetCommitted(Signed::new(
                registration,
                &Self::node(node),
            )));
        }
        made
    }

    /// Appends an entry.
    pub fn append(&mut self, body: Body) {
        self.time_ms += 1;
        self.ledger.append(self.time_ms, body).unwrap();
    }

    /// Appends a whole round.
    pub fn round(&mut self) {
        self.decided_round();
        let contributors = self.ledger.state().contributors();
        let open = self.ledger.state().round().unwrap();
        let (round, base) = (open.number(), open.opened.base);
        self.append(Body::RoundClosed(RoundClosed {
            round,
            global: match contributors.is_empty() {
                true => base,
                false => weights(round as u8, 0x33),
            },
            contributors,
            unanswered: Vec::new(),
            evaluated: None,
        }));
    }

    /// Appends a round that decides about all its nodes, and stays open.
    pub fn decided_round(&mut self) {
        let state = self.ledger.state();
        let (network, round) = (*state.network(), state.next_round());
        let opened = state.next_opening(self.time_ms + 1).unwrap();
        self.append(Body::RoundOpened(opened));
        for node in 0..NAMES.len() as u8 {
            let commitment = UpdateCommitment {
                network,
                round,
                node: Self::id(node),
                dataset_root: Digest([0x20 + node; 32]),
                update: weights(0x10 + node, self.seed),
                eval_samples: 2,
            };
            self.append(Body::UpdateCommitted(Signed::new(
                commitment,
                &Self::node(node),
            )));
        }
        let closed = self
            .ledger
            .state()
            .next_commitments_closed(self.time_ms + 1);
        self.append(Body::CommitmentsClosed(closed.unwrap()));
        let closing = self.ledger.state().round().unwrap().closing.unwrap();
        let drawing = Drawing::LogVrf(self.ledger.vrf(&closing.commitments));
        self.append(Body::RandomnessDrawn(RandomnessDrawn { round, drawing }));
        for node in 0..NAMES.len() as u8 {
            let expected = self.ledger.state().expected_claim(&Self::id(node)).unwrap();
            let claim = expected.with(Losses::Disclosed {
                before: 4_000_000_000 / (round + 2),
                after: 4_000_000_000 / (round + 3),
                elements: 10,
            });
            let proof = self
                .ledger
                .blobs()
                .put(&[NO_PROOF, &[node][..]].concat())
                .unwrap();
            let submission = Signed::new(Submission { claim, proof }, &Self::node(node));
            let last = usize::from(node) + 1 == NAMES.len();
            self.append(match self.lie {
                Some(_) if !last => Body::ContributionAccepted(submission),
                lie => Body::ContributionRejected {
                    submission,
                    reason: lie.unwrap_or(RefusalCode::MalformedProof),
                },
            });
        }
    }
}

fn weights(byte: u8, seed: u8) -> WeightsDigest {
    WeightsDigest {
        blob: Digest([byte ^ seed; 32]),
        quantised: Digest([byte ^ seed ^ 0x80; 32]),
    }
}
