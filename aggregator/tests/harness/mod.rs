//! A network of one aggregator behind a real service on loopback, a clock that the test moves, and nodes that say what they
//! are told to say.
#![allow(dead_code)] // every test file uses its own part of it

use ed25519_dalek::SigningKey;
use std::{path::Path, sync::Arc, time::Duration};
use tempfile::TempDir;
use tokio::{net::TcpListener, sync::oneshot, task::JoinHandle};
use tonic::{transport::Channel, Code, Status};
use zk0_aggregator::{
    publish::cosigning::Witnesses, Aggregator, Config, Limits, ManualClock, Service,
};
use zk0_circuits::{
    model::{
        layout::{expert_tensors, TensorSpec},
        spec::EvalSpec,
    },
    vm::merkle,
    Claim, DatasetCommitment, Digest, Losses, Mode, NodeId, WeightsDigest,
};
use zk0_protocol::rpc::federation::{
    self, federation_client::FederationClient, upload_chunk::Part,
};
use zk0_protocol::{
    entries::{
        entry::{Body, Entry},
        genesis::Genesis,
        signed::{DatasetRegistration, Signed, Submission, UpdateCommitment, UploadRequest},
    },
    rules::{
        bindings::ExpectedClaim,
        governance::{Governance, Governor},
        network_rules::{CreditRule, Rules},
    },
    tlog::{checkpoint::Checkpoint, receipt::Receipt, witness_policy::WitnessPolicy},
};
use zk0_verifier::{blob_digest, Evaluation, ExpertTensors};

pub const START_MS: u64 = 1_700_000_000_000;
/// The seed of the one governor's key.
pub const GOVERNOR: u8 = 99;
pub const VOTING_MS: u64 = 1_000;
pub const COMMIT_MS: u64 = 60_000;
pub const SUBMIT_MS: u64 = 120_000;
pub const MAX_UPDATE_BYTES: u64 = 200_000;
pub const MAX_PROOF_BYTES: u64 = 100_000;
pub const POLICY: &[u8] = b"the whole initial policy";

/// A running aggregator.
pub struct Network {
    pub dir: TempDir,
    pub clock: Arc<ManualClock>,
    pub genesis: Genesis,
    pub config: Config,
    service: Option<Service>,
    limits: Limits,
    /// Witnesses whose quorum is wanted, from the next start on.
    pub policy: Option<WitnessPolicy>,
    pub address: String,
    running: Option<(oneshot::Sender<()>, JoinHandle<()>)>,
}

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
            eval_samples: 4,
            min_improvement_bps: 100,
            max_weight_samples: 1000,
            commit_window_ms: COMMIT_MS,
            submit_window_ms: SUBMIT_MS,
            max_update_bytes: MAX_UPDATE_BYTES,
            max_proof_bytes: MAX_PROOF_BYTES,
            credits: CreditRule {
                bps_samples_per_credit: 100,
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
        program: vec![0; 32],
        mode: Mode::Direct,
        evaluation: spec.encode(),
        policy: blob_digest(POLICY),
        initial: digest(&initial),
    }
}

/// Expert weights that differ with `seed`.
pub fn weights(seed: u32) -> Vec<u8> {
    let tensors = expert_tensors(&EvalSpec::micro().dims);
    let data: Vec<(String, Vec<usize>, Vec<u8>)> = tensors
        .into_iter()
        .enumerate()
        .map(|(tensor, TensorSpec { name, shape })| {
            let value = |at: usize| {
                let mixed =
                    (at as u32 * 2_654_435_761) ^ (tensor as u32 * 40_503) ^ (seed * 97_003);
                (mixed % 2001) as f32 / 10_000.0 - 0.1
            };
            let len = shape.iter().product();
            let bytes = (0..len).flat_map(|at| value(at).to_le_bytes()).collect();
            (name, shape, bytes)
        })
        .collect();
    let views = data.iter().map(|(name, shape, bytes)| {
        let view =
            safetensors::tensor::TensorView::new(safetensors::Dtype::F32, shape.clone(), bytes);
        (name, view.unwrap())
    });
    safetensors::serialize(views, None).unwrap()
}

pub fn digest(file: &[u8]) -> WeightsDigest {
    let evaluation = Evaluation::new(EvalSpec::micro(), Mode::Direct);
    let weights: ExpertTensors = evaluation.read(file).unwrap();
    evaluation.digest(file, &weights).unwrap()
}

impl Network {
    /// Founds a network with these nodes and serves it.
    pub async fn start(nodes: &[&Node], config: Config) -> Self {
        Self::start_with(nodes, config, Limits::default()).await
    }

    pub async fn start_with(nodes: &[&Node], config: Config, limits: Limits) -> Self {
        let dir = tempfile::tempdir().unwrap();
        let clock = Arc::new(ManualClock::at(START_MS));
        let genesis = genesis();
        let mut aggregator = Aggregator::found(
            dir.path(),
            genesis.clone(),
            log_key(),
            POLICY,
            &weights(0),
            clock.clone(),
            config,
        )
        .unwrap();
        for (number, node) in nodes.iter().enumerate() {
            aggregator
                .enrol(node.id(), format!("node-{number}"))
                .unwrap();
        }
        let mut network = Self {
            dir,
            clock,
            genesis,
            config,
            service: Some(Service::with_limits(aggregator, limits)),
            limits,
            policy: None,
            address: String::new(),
            running: None,
        };
        network.serve().await;
        network
    }

    async fn serve(&mut self) {
        let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
        self.address = format!("http://{}", listener.local_addr().unwrap());
        let (stop, stopped) = oneshot::channel::<()>();
        let service = self.service().clone();
        let task = tokio::spawn(async move {
            let stopped = async {
                let _ = stopped.await;
            };
            service.serve(listener, stopped).await.unwrap();
        });
        self.running = Some((stop, task));
    }

    /// Kills the aggregator and starts it again on what is on disk.
    pub async fn restart(&mut self) {
        let (stop, task) = self.running.take().unwrap();
        task.abort(); // without a goodbye
        let _ = task.await;
        drop(stop);
        // The database is locked until every clone of the old service is gone: requests that were in progress hold one.
        let mut tries = 0;
        self.service = None;
        let aggregator = loop {
            match self.open() {
                Ok(aggregator) => break aggregator,
                Err(error) if tries < 100 && error.to_string().contains("in use") => {
                    tries += 1;
                    tokio::time::sleep(Duration::from_millis(50)).await;
                }
                Err(error) => panic!("{error}"),
            }
        };
        let mut service = Service::with_limits(aggregator, self.limits);
        if let Some(policy) = &self.policy {
            let witnesses = Witnesses::new(policy.clone(), Duration::from_secs(1)).unwrap();
            service = service.witnessed(witnesses).await.unwrap();
        }
        self.service = Some(service);
        self.serve().await;
    }

    fn open(&self) -> Result<Aggregator, zk0_aggregator::round::request::RequestError> {
        Aggregator::open(
            self.dir.path(),
            Some(&self.genesis.network_id()),
            log_key(),
            self.clock.clone(),
            self.config,
        )
    }

    pub fn service(&self) -> &Service {
        self.service.as_ref().unwrap()
    }

    /// Lets the aggregator look at the clock until nothing changes.
    pub async fn settle(&self) {
        use zk0_aggregator::Progress;
        loop {
            let progress = self.service().with(Aggregator::step).await.unwrap();
            if matches!(progress, Progress::Waiting | Progress::Finished) {
                return;
            }
        }
    }

    pub async fn entries(&self) -> Vec<Entry> {
        self.service()
            .with(|aggregator| {
                let ledger = aggregator.ledger();
                Ok((0..ledger.size())
                    .map(|at| ledger.entry(at).unwrap())
                    .collect())
            })
            .await
            .unwrap()
    }

    pub async fn last(&self) -> Body {
        self.entries().await.pop().unwrap().body
    }

    pub async fn client(&self) -> FederationClient<Channel> {
        FederationClient::connect(self.address.clone())
            .await
            .unwrap()
    }

    pub async fn round(&self, round: Option<u64>) -> proto::RoundInfo {
        let request = proto::GetRoundRequest {
            round,
            node: Vec::new(),
        };
        self.client()
            .await
            .get_round(request)
            .await
            .unwrap()
            .into_inner()
    }

    /// Opens a receipt with nothing but the genesis.
    pub fn opened(&self, receipt: proto::Receipt) -> (u64, Checkpoint, Entry) {
        let receipt = Receipt {
            index: receipt.index,
            entry: receipt.entry,
            checkpoint: receipt.checkpoint.into_bytes(),
            proof: receipt
                .inclusion
                .into_iter()
                .map(|hash| Digest(hash.try_into().unwrap()))
                .collect(),
        };
        let index = receipt.index;
        let (checkpoint, entry) = receipt
            .verify(&self.genesis.log_key, &self.genesis.name)
            .unwrap();
        (index, checkpoint, entry)
    }

    pub async fn download(&self, blob: Digest) -> Result<Vec<u8>, Status> {
        let request = proto::DownloadRequest {
            blob: blob.0.to_vec(),
        };
        let mut stream = self.client().await.download(request).await?.into_inner();
        let mut bytes = Vec::new();
        while let Some(chunk) = stream.message().await? {
            bytes.extend(chunk.data);
        }
        Ok(bytes)
    }

    pub fn uploads(&self) -> usize {
        files(&self.dir.path().join("uploads"))
    }
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

/// A node that signs what it is told to.
pub struct Node {
    pub key: SigningKey,
    pub seed: u8,
}

impl Node {
    pub fn new(seed: u8) -> Self {
        Self {
            key: SigningKey::from_bytes(&[seed; 32]),
            seed,
        }
    }

    pub fn id(&self) -> NodeId {
        NodeId(self.key.verifying_key().to_bytes())
    }

    pub fn leaves(&self) -> Vec<Digest> {
        (0..10).map(|at| Digest([self.seed ^ at; 32])).collect()
    }

    pub fn dataset(&self) -> DatasetCommitment {
        let leaves = self.leaves();
        DatasetCommitment {
            root: merkle::root(&leaves),
            samples: leaves.len() as u64,
            feature_spec: Digest([1; 32]),
            salt_commitment: Digest([self.seed; 32]),
        }
    }

    pub fn registration(&self, network: &Digest) -> Signed<DatasetRegistration> {
        let registration = DatasetRegistration {
            network: *network,
            node: self.id(),
            dataset: self.dataset(),
            leaves: blob_digest(&flat(&self.leaves())),
            episodes: vec![Digest([self.seed; 32])],
        };
        Signed::new(registration, &self.key)
    }

    pub async fn register(&self, network: &Network) -> Result<proto::Receipt, Status> {
        self.register_as(
            network,
            &self.registration(&network.genesis.network_id()),
            &self.leaves(),
        )
        .await
    }

    pub async fn register_as(
        &self,
        network: &Network,
        registration: &Signed<DatasetRegistration>,
        leaves: &[Digest],
    ) -> Result<proto::Receipt, Status> {
        let request = proto::RegisterDatasetRequest {
            registration: borsh::to_vec(registration).unwrap(),
            leaves: flat(leaves),
        };
        let reply = network.client().await.register_dataset(request).await?;
        Ok(reply.into_inner())
    }

    pub fn upload_request(&self, network: &Digest, round: u64, bytes: &[u8]) -> UploadRequest {
        UploadRequest {
            network: *network,
            round,
            node: self.id(),
            blob: blob_digest(bytes),
            size: bytes.len() as u64,
        }
    }

    pub async fn upload(&self, network: &Network, round: u64, bytes: &[u8]) -> Result<(), Status> {
        let request = Signed::new(
            self.upload_request(&network.genesis.network_id(), round, bytes),
            &self.key,
        );
        self.upload_as(network, &request, bytes).await
    }

    pub async fn upload_as(
        &self,
        network: &Network,
        request: &Signed<UploadRequest>,
        bytes: &[u8],
    ) -> Result<(), Status> {
        let first = Part::Request(borsh::to_vec(request).unwrap());
        let data = bytes.chunks(1000).map(|data| Part::Data(data.to_vec()));
        let parts: Vec<_> = std::iter::once(first)
            .chain(data)
            .map(|part| proto::UploadChunk { part: Some(part) })
            .collect();
        network
            .client()
            .await
            .upload(tokio_stream::iter(parts))
            .await?;
        Ok(())
    }

    pub fn commitment(&self, network: &Digest, round: u64, update: &[u8]) -> UpdateCommitment {
        UpdateCommitment {
            network: *network,
            round,
            node: self.id(),
            dataset_root: self.dataset().root,
            update: digest(update),
        }
    }

    pub async fn commit(
        &self,
        network: &Network,
        round: u64,
        update: &[u8],
    ) -> Result<proto::Receipt, Status> {
        let commitment = Signed::new(
            self.commitment(&network.genesis.network_id(), round, update),
            &self.key,
        );
        self.commit_as(network, &commitment).await
    }

    pub async fn commit_as(
        &self,
        network: &Network,
        commitment: &Signed<UpdateCommitment>,
    ) -> Result<proto::Receipt, Status> {
        let commitment = borsh::to_vec(commitment).unwrap();
        let request = proto::CommitRequest { commitment };
        Ok(network.client().await.commit(request).await?.into_inner())
    }

    /// The claim that the ledger expects, with losses as if it held.
    pub async fn claim(&self, network: &Network) -> Claim {
        let node = self.id();
        let expected = network
            .service()
            .with(move |aggregator| Ok(aggregator.state().expected_claim(&node)?))
            .await
            .unwrap();
        self.claim_of(expected)
    }

    pub fn claim_of(&self, expected: ExpectedClaim) -> Claim {
        let mut claim = expected.with(Losses::Disclosed {
            before: 1000,
            after: 900,
            elements: 10,
        });
        claim.terms.node = self.id();
        claim
    }

    pub fn submission(&self, claim: Claim, proof: &[u8]) -> Signed<Submission> {
        let proof = blob_digest(proof);
        Signed::new(Submission { claim, proof }, &self.key)
    }

    pub async fn submit(
        &self,
        network: &Network,
        claim: Claim,
        proof: &[u8],
    ) -> Result<proto::SubmitReply, Status> {
        self.submit_as(network, &self.submission(claim, proof), proof)
            .await
    }

    pub async fn submit_as(
        &self,
        network: &Network,
        submission: &Signed<Submission>,
        proof: &[u8],
    ) -> Result<proto::SubmitReply, Status> {
        let request = proto::SubmitRequest {
            submission: borsh::to_vec(submission).unwrap(),
            proof: proof.to_vec(),
        };
        Ok(network.client().await.submit(request).await?.into_inner())
    }
}

pub fn flat(leaves: &[Digest]) -> Vec<u8> {
    leaves.iter().flat_map(|leaf| leaf.0).collect()
}

/// A network of two nodes with datasets, in the open round 0.
pub async fn open_round() -> (Network, Node, Node) {
    let (first, second) = (Node::new(1), Node::new(2));
    let config = Config {
        rounds: Some(2),
        min_nodes: 2,
    };
    let network = Network::start(&[&first, &second], config).await;
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

/// The request is turned down with this code and words, and leaves no entry.
#[track_caller]
pub fn refused<T: std::fmt::Debug>(result: Result<T, Status>, code: Code, words: &str) {
    let status = result.unwrap_err();
    assert_eq!(status.code(), code, "{status}");
    assert!(status.message().contains(words), "{status}");
}
