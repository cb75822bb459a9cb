//! The readers that get random inputs, and the inputs that fuzzing starts from.

use std::path::Path;
use std::sync::Arc;

use borsh::BorshDeserialize;
use zk0_aggregator::round::request_error::RequestError;
use zk0_aggregator::{Aggregator, Config, Polled, RoundStep};
use zk0_audit::{Auditor, Depth};
use zk0_circuits::{Digest, NodeId};
use zk0_ledger::replay::{replay, Finding, Recheck};
use zk0_ledger::Blobs;
use zk0_protocol::entries::proposal::{Action, Ballot};
use zk0_protocol::entries::signed::{
    DatasetRegistration, Enrolment, Proposal, SignableStatement, Signed, UpdateCommitment,
    UploadRequest, Vote,
};
use zk0_protocol::{Body, Entry, Genesis, Refusal, RefusalCode, State};
use zk0_verifier::blob_digest;

use zk0_testkit::aggregator::{
    found, genesis, log_key, weights, AtOnce, ManualClock, SigningNode, COMMIT_MS, GOVERNOR, REAL,
    START_MS,
};
use zk0_testkit::fuzzing::{Target, Targets};

const NAMES: [&str; 7] = [
    "record",
    "enrolment",
    "registration",
    "upload",
    "commitment",
    "submission",
    "audit_memory",
];

pub const TARGETS: Targets = Targets {
    names: &NAMES,
    target,
    // An uploaded update is read again, and an auditor verifies a whole proof.
    slack: 8 << 20,
};

fn target(name: &str) -> Target {
    match name {
        "record" => record(),
        "enrolment" => enrolment(),
        "registration" => registration(),
        "upload" => upload(),
        "commitment" => commitment(),
        "submission" => submission(),
        "audit_memory" => audit_memory(),
        other => panic!("no target {other}; there are {NAMES:?}"),
    }
}

/// The only proof that is submitted.
const PROOF: &[u8] = b"no proof";

/// An aggregator in round 0, to which node 1 has uploaded an update. Node 2 may contribute. Node 3 has no dataset.
struct Network {
    dir: tempfile::TempDir,
    clock: Arc<ManualClock>,
    aggregator: Aggregator,
    id: Digest,
    nodes: [SigningNode; 3],
    update: Vec<u8>,
}

impl Network {
    fn new() -> Self {
        let dir = tempfile::tempdir().unwrap();
        let config = Config {
            rounds: None,
            min_nodes: 2,
        };
        let (clock, genesis) = (Arc::new(ManualClock::at(START_MS)), genesis());
        let id = genesis.network_id();
        let founded = found(dir.path(), genesis, clock.clone(), config);
        let mut aggregator = founded.unwrap();
        let nodes = [1, 2, 3].map(SigningNode::new);
        for node in &nodes {
            let name = format!("node-{}", node.seed);
            aggregator.enrol(node.id(), name).unwrap();
        }
        for node in &nodes[..2] {
            let registration = bytes(&node.registration(&id));
            aggregator.register(&registration, &node.list()).unwrap();
        }
        assert_eq!(aggregator.step().unwrap(), Polled::Did(RoundStep::Open(0)));
        let update = weights(1);
        let request = Signed::new(nodes[0].upload_request(&id, 0, &update), &nodes[0].key);
        let writer = aggregator.upload(&bytes(&request)).unwrap();
        let mut writer = writer.unwrap();
        writer.write(&update).unwrap();
        writer.finish().unwrap();
        Self {
            dir,
            clock,
            aggregator,
            id,
            nodes,
            update,
        }
    }
}

fn bytes(value: &impl borsh::BorshSerialize) -> Vec<u8> {
    borsh::to_vec(value).unwrap()
}

fn text(error: impl ToString) -> String {
    error.to_string()
}

/// Signs a statement anew if it names `node` as its signer. Leaves all other bytes as they are.
fn sign_anew<T: SignableStatement + BorshDeserialize>(input: &[u8], node: &SigningNode) -> Vec<u8> {
    match borsh::from_slice::<Signed<T>>(input) {
        Ok(signed) if signed.statement.signer() == node.id() => {
            bytes(&Signed::new(signed.statement, &node.key))
        }
        _ => input.to_vec(),
    }
}

/// Requests to record what members sign. The ledger has recorded these already. Other signed statements are inputs of the ledger's
/// target `applied`.
fn record() -> Target {
    let Network {
        dir,
        mut aggregator,
        id,
        ..
    } = Network::new();
    let governor = SigningNode::new(GOVERNOR);
    let proposal = Proposal {
        network: id,
        number: 0,
        proposer: governor.id(),
        title: "a better network".into(),
        text: "because".into(),
        action: Action::Suspend(SigningNode::new(2).id()),
    };
    let vote = Vote {
        network: id,
        proposal: 0,
        of: proposal.digest(),
        voter: governor.id(),
        ballot: Ballot::For,
    };
    let seeds = vec![
        bytes(&Body::Proposed(Signed::new(proposal, &governor.key))),
        bytes(&Body::Voted(Signed::new(vote, &governor.key))),
    ];
    for seed in &seeds {
        aggregator.tell(seed).unwrap();
    }
    Target {
        seeds,
        run: Box::new(move |input| {
            let _ = &dir;
            aggregator.tell(input).map(drop).map_err(text)
        }),
    }
}

/// Enrolments of two nodes, which are recorded already.
fn enrolment() -> Target {
    let Network {
        dir,
        mut aggregator,
        id,
        ..
    } = Network::new();
    let key = log_key();
    let seeds = [4, 5].map(|seed| {
        let enrolment = Enrolment {
            network: id,
            operator: NodeId(key.verifying_key().to_bytes()),
            node: SigningNode::new(seed).id(),
            name: format!("node-{seed}"),
        };
        bytes(&Signed::new(enrolment, &key))
    });
    for seed in &seeds {
        aggregator.let_in(seed).unwrap();
    }
    Target {
        seeds: seeds.into(),
        run: Box::new(move |input| {
            let _ = &dir;
            aggregator.let_in(input).map(drop).map_err(text)
        }),
    }
}

/// A registration with its length before it, and then a list of leaves. A registration of node 3 is signed anew with the digest of
/// its leaves. Node 3 is never registered, because it commits to a wrong root.
fn registration() -> Target {
    let mut network = Network::new();
    let with_leaves = |registration: Vec<u8>, leaves: Vec<u8>| {
        let length = (registration.len() as u32).to_le_bytes();
        [&length[..], &registration, &leaves].concat()
    };
    let seeds = network.nodes.each_ref().map(|node| {
        let mut statement = node.registration(&network.id).statement;
        if node.seed == 3 {
            statement.dataset.root = Digest([8; 32]);
        }
        let signed = Signed::new(statement, &node.key);
        with_leaves(bytes(&signed), node.list())
    });
    Target {
        seeds: seeds.into(),
        run: Box::new(move |input| {
            let network = &mut network;
            let (length, rest) = input.split_first_chunk::<4>().ok_or("no length")?;
            let length = (u32::from_le_bytes(*length) as usize).min(rest.len());
            let (registration, leaves) = rest.split_at(length);
            let registration = with_digest(registration, leaves, &network.nodes[2]);
            match network.aggregator.register(&registration, leaves) {
                Err(error) if error.to_string().contains("leaves hash to root") => Ok(()),
                other => other.map(drop).map_err(text),
            }
        }),
    }
}

fn with_digest(registration: &[u8], leaves: &[u8], node: &SigningNode) -> Vec<u8> {
    match borsh::from_slice::<Signed<DatasetRegistration>>(registration) {
        Ok(signed) if signed.statement.node == node.id() => {
            let statement = DatasetRegistration {
                leaves: blob_digest(leaves),
                ..signed.statement
            };
            bytes(&Signed::new(statement, &node.key))
        }
        _ => registration.to_vec(),
    }
}

fn upload() -> Target {
    let mut network = Network::new();
    let seeds = [0, 1].map(|at| {
        let node = &network.nodes[at];
        let request = node.upload_request(&network.id, 0, &network.update);
        bytes(&Signed::new(request, &node.key))
    });
    Target {
        seeds: seeds.into(),
        run: Box::new(move |input| {
            let network = &mut network;
            let input = sign_anew::<UploadRequest>(input, &network.nodes[1]);
            let begun = network.aggregator.upload(&input);
            begun.map(drop).map_err(text)
        }),
    }
}

/// A commitment of node 2 is signed anew. The aggregator always refuses it, because node 2 has uploaded nothing.
fn commitment() -> Target {
    let mut network = Network::new();
    let updates = [network.update.clone(), weights(2)];
    let seeds = [0, 1].map(|at| {
        let node = &network.nodes[at];
        let commitment = node.commitment(&network.id, 0, &updates[at]);
        bytes(&Signed::new(commitment, &node.key))
    });
    Target {
        seeds: seeds.into(),
        run: Box::new(move |input| {
            let network = &mut network;
            let input = sign_anew::<UpdateCommitment>(input, &network.nodes[1]);
            match network.aggregator.commit(&input) {
                Err(RequestError::Refused(Refusal {
                    code: RefusalCode::MissingUpdate(_),
                    ..
                })) => Ok(()),
                other => other.map(drop).map_err(text),
            }
        }),
    }
}

/// Submissions of node 1. The first one is decided before the others come.
fn submission() -> Target {
    let mut network = Network::new();
    let node = &network.nodes[0];
    let commitment = node.commitment(&network.id, 0, &network.update);
    let commitment = bytes(&Signed::new(commitment, &node.key));
    network.aggregator.commit(&commitment).unwrap();
    network.clock.advance(COMMIT_MS + 1);
    for _ in ["the commitments close", "the randomness is drawn"] {
        network.aggregator.step().unwrap();
    }
    let node = &network.nodes[0];
    let expected = network.aggregator.state().expected_claim(&node.id());
    let claim = node.claim_of(expected.unwrap());
    let submission = bytes(&node.submission(claim, PROOF));
    network
        .aggregator
        .submit(&submission, PROOF.to_vec())
        .unwrap();
    Target {
        seeds: vec![submission],
        run: Box::new(move |input| {
            let network = &mut network;
            let decided = network.aggregator.submit(input, PROOF.to_vec());
            decided.map(drop).map_err(text)
        }),
    }
}

/// Keeps what an auditor remembers after each entry of a real ledger.
struct Memories {
    auditor: Auditor,
    saved: Vec<Vec<u8>>,
}

impl Recheck for Memories {
    fn genesis(&mut self, genesis: &Genesis, blobs: &Blobs) -> Vec<Finding> {
        self.auditor.genesis(genesis, blobs)
    }

    fn entry(&mut self, before: &State, index: u64, entry: &Entry, blobs: &Blobs) -> Vec<Finding> {
        let mut found = self.auditor.entry(before, index, entry, blobs);
        found.extend(self.auditor.settle());
        self.saved.push(self.auditor.save());
        found
    }
}

/// Reads what an auditor remembers besides the ledger's own state.
fn audit_memory() -> Target {
    let dir = Path::new(REAL);
    let mut memories = Memories {
        auditor: Auditor::new(Depth::Full),
        saved: Vec::new(),
    };
    replay(dir, None, &mut memories);
    let saved = memories.saved;
    // The seeds are the last memory, and the largest, from a round that has accepted something.
    let largest = saved.iter().max_by_key(|saved| saved.len()).unwrap();
    let blobs = Blobs::at(dir);
    Target {
        seeds: vec![saved.last().unwrap().clone(), largest.clone()],
        run: Box::new(move |input| {
            let mut auditor = Auditor::new(Depth::Full).go_on(input, &blobs)?;
            auditor.settle();
            let _ = (auditor.checked(), auditor.not_checked());
            Ok(())
        }),
    }
}
