//! Nodes with the node's own client and made-up datasets. An update is any bytes: nothing reads it before its submission.

use ed25519_dalek::SigningKey;
use serde_json::Value;
use sha2::{Digest as _, Sha256};
use std::fs;
use std::path::Path;
use zk0_audit::verified_entries::verified_entries;
use zk0_circuits::vm::merkle;
use zk0_circuits::{DatasetCommitment, Digest, NodeId, WeightsDigest};
use zk0_node::client::NodeClient;
use zk0_node::client_error::NodeError;
use zk0_protocol::entries::entry::Body;
use zk0_protocol::entries::signed::{DatasetRegistration, RegisteredEpisode};
use zk0_protocol::evaluation_set::{draw, list_bytes, DrawnLeaf};

/// All drawn.
const FRAMES: u32 = 10;

const EVAL_SAMPLES: u32 = 4;

/// The node of this number.
#[derive(Clone, Copy)]
pub struct Member(pub u16);

impl Member {
    fn key(self) -> SigningKey {
        SigningKey::from_bytes(&self.bytes(0).0)
    }

    /// The identity.
    pub fn id(self) -> NodeId {
        NodeId(self.key().verifying_key().to_bytes())
    }

    fn bytes(self, number: u64) -> Digest {
        let text = format!("member {} {number}", self.0);
        Digest(Sha256::digest(text).into())
    }

    fn leaves(self) -> Vec<Digest> {
        (0..u64::from(FRAMES)).map(|at| self.bytes(at)).collect()
    }

    fn dataset(self) -> DatasetCommitment {
        DatasetCommitment {
            root: merkle::root(&self.leaves()),
            samples: FRAMES.into(),
            feature_spec: Digest([1; 32]),
            salt_commitment: self.bytes(0),
        }
    }

    /// Connects, and registers a dataset.
    pub async fn join(self, aggregator: &str, network: Digest) -> NodeClient {
        let node = NodeClient::connect(aggregator.to_owned(), network, self.key());
        let mut node = node.await.unwrap();
        let episodes = vec![RegisteredEpisode {
            digest: self.bytes(0),
            frames: FRAMES,
        }];
        let drawn = draw(&network, &episodes, FRAMES).unwrap();
        let drawn = drawn.into_iter().zip(self.leaves());
        let drawn: Vec<_> = drawn
            .map(|(frame, leaf)| DrawnLeaf { frame, leaf })
            .collect();
        let list = list_bytes(&drawn);
        let registration = DatasetRegistration {
            network,
            node: self.id(),
            dataset: self.dataset(),
            evaluation_frames: FRAMES,
            leaves: Digest(Sha256::digest(&list).into()),
            episodes,
        };
        node.register(registration, list).await.unwrap();
        node
    }

    /// A unique update of this size.
    pub fn update(self, bytes: usize) -> Vec<u8> {
        let mut update = vec![self.0 as u8; bytes];
        for (number, block) in update.chunks_mut(4096).enumerate() {
            let tag = self.bytes(number as u64).0;
            let shown = block.len().min(tag.len());
            block[..shown].copy_from_slice(&tag[..shown]);
        }
        update
    }

    /// Uploads for the first round.
    pub async fn upload(self, node: &mut NodeClient, update: Vec<u8>) -> Result<Digest, NodeError> {
        let blob = Digest(Sha256::digest(&update).into());
        node.upload(0, update).await?;
        Ok(blob)
    }

    /// Commits in the first round.
    pub async fn commit(self, node: &mut NodeClient, blob: Digest) -> Result<(), NodeError> {
        let update = WeightsDigest {
            blob,
            quantised: self.bytes(1),
        };
        let root = self.dataset().root;
        node.commit(0, &root, &update, EVAL_SAMPLES).await?;
        Ok(())
    }
}

/// Founds the members' network in `dir`, as `ledger` beside `log.key`, for updates of up to this size. `run` runs the program for its
/// output. Returns the network's id.
pub fn found(
    dir: &Path,
    members: &[Member],
    bytes: u64,
    run: impl Fn(&[&str]) -> String,
) -> Digest {
    let path = |name: &str| dir.join(name).to_str().unwrap().to_owned();
    let key = path("log.key");
    run(&["aggregator", "keygen", &key]);
    let mut rules: Value = serde_json::from_str(&run(&["aggregator", "rules"])).unwrap();
    for (rule, value) in [
        ("min_dataset_samples", 4),
        ("min_eval_samples", EVAL_SAMPLES.into()),
        ("evaluation_frames", FRAMES.into()),
        ("max_update_bytes", bytes.max(1 << 20)),
        // Without submissions, a round ends soon.
        ("submit_window_ms", 1000),
        ("commit_window_ms", 3_600_000),
    ] {
        assert!(rules[rule].is_u64(), "{rule}");
        rules[rule] = value.into();
    }
    fs::write(path("rules.json"), rules.to_string()).unwrap();
    let (ledger, rules) = (path("ledger"), path("rules.json"));
    let founding = ["aggregator", "init", &ledger, "--name", "members"];
    let with = ["--key", &key, "--rules", &rules, "--rules-never-change"];
    let named = members.iter().map(|one| format!("m{}={}", one.0, one.id()));
    let named: Vec<_> = named.flat_map(|name| ["--node".to_owned(), name]).collect();
    let named: Vec<_> = named.iter().map(String::as_str).collect();
    run(&[&founding[..], &with, &named].concat());
    match verified_entries(&dir.join("ledger"))
        .unwrap()
        .0
        .remove(0)
        .body
    {
        Body::Genesis(genesis) => genesis.network_id(),
        other => panic!("{other:?}"),
    }
}
