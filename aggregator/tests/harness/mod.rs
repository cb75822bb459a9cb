//! A network of one aggregator behind a real service on loopback, a clock that the test moves, and nodes that say what they
//! are told to say.
#![allow(dead_code)] // Every test file uses only a part of it

mod at_once;
mod manual_clock;
mod network;
mod node;
pub mod operator;
pub mod real_proof;
pub mod samples;
pub mod witnesses;

pub use self::at_once::AtOnce;
pub use self::manual_clock::ManualClock;
pub use self::network::Network;
pub use self::node::Node;

use ed25519_dalek::SigningKey;
use std::fs;
use std::io::{self, Write};
use std::path::Path;
use std::sync::Arc;
use tempfile::TempDir;
use tonic::{Code, Status};
use zk0_aggregator::round::founding::Founding;
use zk0_aggregator::round::request::RequestError;
use zk0_aggregator::{Aggregator, Config, Limits};
use zk0_circuits::claim::program::verifying_key;
use zk0_circuits::model::spec::EvalSpec;
use zk0_circuits::{Digest, Mode, WeightsDigest};
use zk0_protocol::entries::genesis::Genesis;
use zk0_protocol::entries::signed::DatasetRegistration;
use zk0_protocol::evaluation_set::{draw, list_bytes, DrawnLeaf};
use zk0_protocol::rules::closing::credits::CreditRule;
use zk0_protocol::rules::governance::{Governance, Governor};
use zk0_protocol::rules::network_rules::Rules;
use zk0_verifier::{blob_digest, Evaluation};
use zk0_weights::scale::narrowed;
use zk0_weights::{Format, WeightsError};

/// A ledger with a real proof in it.
pub const REAL: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../tests/fixtures/ledger");
pub const START_MS: u64 = 1_700_000_000_000;
/// The seed of the one governor's key.
pub const GOVERNOR: u8 = 99;
pub const VOTING_MS: u64 = 1_000;
pub const COMMIT_MS: u64 = 60_000;
pub const SUBMIT_MS: u64 = 120_000;
pub const EVALUATION_FRAMES: u32 = 10;
pub const MAX_UPDATE_BYTES: u64 = 200_000;
pub const MAX_PROOF_BYTES: u64 = 100_000;
/// Bytes of [`Network::long_download`].
pub const LONG_BYTES: u64 = 8 << 20;
/// The whole initial policy: bytes that take several messages.
pub const POLICY: &[u8] = &{
    let mut bytes = [0; 200_000];
    let mut at = 0;
    while at < bytes.len() {
        bytes[at] = (at % 251) as u8;
        at += 1;
    }
    bytes
};

pub fn log_key() -> SigningKey {
    SigningKey::from_bytes(&[42; 32])
}

pub fn genesis() -> Genesis {
    let spec = EvalSpec::micro();
    let initial = weights(0);
    Genesis {
        name: "test.example/zk0".into(),
        log_key: log_key().verifying_key().to_bytes(),
        nonce: [7; 32],
        rules: Rules {
            min_dataset_samples: 4,
            min_eval_samples: 4,
            min_improvement_bps: 100,
            commit_window_ms: COMMIT_MS,
            submit_window_ms: SUBMIT_MS,
            evaluation_frames: EVALUATION_FRAMES,
            max_update_bytes: MAX_UPDATE_BYTES,
            max_proof_bytes: MAX_PROOF_BYTES,
            credits: CreditRule {
                bps_per_credit: 100,
                max_per_contribution: 1000,
                dispute_window_ms: 1000,
            },
            governance: Governance {
                governors: vec![Governor {
                    key: Node::new(GOVERNOR).id(),
                    name: "governor".into(),
                    weight: 1,
                }],
                voting_ms: VOTING_MS,
                ..Governance::none()
            },
            ..Rules::default()
        },
        program: verifying_key(Mode::Direct).to_vec(),
        mode: Mode::Direct,
        evaluation: spec.encode(),
        policy: blob_digest(POLICY),
        initial: digest(&initial),
    }
}

/// What a network of this genesis begins with.
pub fn founding(genesis: Genesis) -> Founding {
    Founding {
        name: genesis.name,
        nonce: genesis.nonce,
        rules: genesis.rules,
        program: genesis.program,
        mode: genesis.mode,
        evaluation: EvalSpec::decode(&genesis.evaluation).unwrap(),
        initial: weights(0),
        quantised: genesis.initial.quantised,
        public_samples: None,
    }
}

/// Writes the policy file.
pub fn write_policy(out: &mut dyn Write) -> io::Result<[u8; 32]> {
    out.write_all(POLICY)?;
    Ok(blob_digest(POLICY).0)
}

/// A copy of a folder, with all that is in it.
pub fn copy_of(folder: &Path) -> TempDir {
    fn copy(from: &Path, to: &Path) {
        fs::create_dir_all(to).unwrap();
        for found in fs::read_dir(from).unwrap() {
            let found = found.unwrap();
            let (path, place) = (found.path(), to.join(found.file_name()));
            match path.is_dir() {
                true => copy(&path, &place),
                false => drop(fs::copy(&path, &place).unwrap()),
            }
        }
    }
    let dir = tempfile::tempdir().unwrap();
    copy(folder, dir.path());
    dir
}

/// Founds the network of `genesis` in `dir`, and opens it.
pub fn found(
    dir: &Path,
    genesis: Genesis,
    clock: Arc<ManualClock>,
    config: Config,
) -> Result<Aggregator, RequestError> {
    let ledger = founding(genesis.clone())
        .found(dir, log_key(), &*clock, 1 << 20, write_policy)
        .unwrap();
    assert_eq!(*ledger.state().genesis(), genesis);
    drop(ledger);
    let network = genesis.network_id();
    Aggregator::open(dir, Some(&network), log_key(), clock, config)
}

/// Expert weights that differ with `seed`.
pub fn weights(seed: u32) -> Vec<u8> {
    let format = Format::new(&EvalSpec::micro()).unwrap();
    let weights = format.assemble(|tensor| {
        let value = |at: usize| {
            let mixed = (at as u32 * 2_654_435_761) ^ (tensor as u32 * 40_503) ^ (seed * 97_003);
            // About 0.1 at most, in units of 2^−24.
            i128::from(mixed % 2001) * 1678 - 1_678_000
        };
        let values: Vec<_> = (0..format.tensors()[tensor].len()).map(value).collect();
        Ok::<_, WeightsError>(narrowed(&values, 1, format.limits()[tensor]))
    });
    format.write(&weights.unwrap())
}

pub fn digest(file: &[u8]) -> WeightsDigest {
    let evaluation = Evaluation::new(&EvalSpec::micro(), Mode::Direct).unwrap();
    evaluation.digest(file, &evaluation.read(file).unwrap())
}

/// Files in a folder, at any depth.
pub fn files(folder: &Path) -> usize {
    let Ok(entries) = std::fs::read_dir(folder) else {
        return 0;
    };
    entries
        .map(|entry| match entry.unwrap().path() {
            path if path.is_dir() => files(&path),
            _ => 1,
        })
        .sum()
}

/// The list of a registration's drawn frames, with these leaves in order. If there are fewer leaves than frames, it ends early.
pub fn list(registration: &DatasetRegistration, leaves: &[Digest]) -> Vec<u8> {
    let DatasetRegistration {
        network,
        episodes,
        evaluation_frames,
        ..
    } = registration;
    let frames = draw(network, episodes, *evaluation_frames).unwrap();
    let drawn = frames.into_iter().zip(leaves);
    let drawn = drawn.map(|(frame, leaf)| DrawnLeaf { frame, leaf: *leaf });
    list_bytes(&drawn.collect::<Vec<_>>())
}

/// A network of two nodes with datasets, in the open round 0.
pub async fn open_round() -> (Network, Node, Node) {
    open_round_of(genesis()).await
}

/// The network of `genesis` in the open round 0, with two nodes that have datasets.
pub async fn open_round_of(genesis: Genesis) -> (Network, Node, Node) {
    let (first, second) = (Node::new(1), Node::new(2));
    let config = Config {
        rounds: Some(2),
        min_nodes: 2,
    };
    let nodes = [&first, &second];
    let network = Network::start_as(&nodes, config, Limits::default(), genesis, None, None).await;
    first.register(&network).await.unwrap();
    second.register(&network).await.unwrap();
    network.settle().await;
    (network, first, second)
}

/// Uploads and commits update number `seed`.
pub async fn committed(network: &Network, node: &Node, round: u64, seed: u32) -> Vec<u8> {
    let update = weights(seed);
    node.upload(network, round, &update).await.unwrap();
    node.commit(network, round, &update).await.unwrap();
    update
}

/// Both nodes commit in the open round: the first one to the update that this returns.
pub async fn both_committed(network: &Network, first: &Node, second: &Node) -> Vec<u8> {
    committed(network, second, 0, 2).await;
    committed(network, first, 0, 1).await
}

/// Asserts that the request is refused with this code and these words.
#[track_caller]
pub fn refused<T: std::fmt::Debug>(result: Result<T, Status>, code: Code, words: &str) {
    let status = result.unwrap_err();
    assert_eq!(status.code(), code, "{status}");
    assert!(status.message().contains(words), "{status}");
}
