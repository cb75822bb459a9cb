//! A network on this machine. The binary founds and joins it; an aggregator and a prover run in the test. The prover makes no real proofs,
//! so no contribution is accepted, and each round starts from the same weights.

use super::{logged, logs, name_cameras, prints, root, words, zk0, RECORDING};
use serde_json::{json, Value};
use std::fs;
use std::path::Path;
use std::process::Output;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::Arc;
use tempfile::TempDir;
use tokio::net::TcpListener;
use tokio::runtime::Runtime;
use zk0::keys;
use zk0_aggregator::{Aggregator, Config, Service, SystemClock};
use zk0_audit::verified_entries::verified_entries;
use zk0_circuits::{Digest, EvalSpec};
use zk0_ledger::log::Ledger;
use zk0_lerobot::dataset::Dataset;
use zk0_node::recording::evaluation_set::{EvaluationSet, EvaluationSetSpec};
use zk0_node::recording::secret::Secrets;
use zk0_node::recording::{prepare_samples, OpenRecording};
use zk0_protocol::entries::entry::{Body, Entry};
use zk0_protocol::entries::genesis::Genesis;
use zk0_prover::program::{Execution, GuestInput};
use zk0_prover::prove::Proof;
use zk0_prover::service::{Backend, JobError, Pace, ProvingService, WaitingClient};
use zk0_service::tls::server_certificate::ServerCertificate;
use zk0_smolvla::frames::sample::PreparedSample;
use zk0_smolvla::policy::policy_file::{self, PolicyFile};
use zk0_testkit::until;

/// The option of a network that nobody governs, unless these options of `zk0 aggregator init` name governors.
fn unless_governed(options: &[&str]) -> Option<&'static str> {
    let governors = |file: &&str| {
        let rules: Value = serde_json::from_str(&fs::read_to_string(file).ok()?).ok()?;
        Some(rules["governance"]["governors"].as_array()?.len())
    };
    let in_file = options.iter().any(|option| governors(option) > Some(0));
    let is_governed = in_file || options.contains(&"--governor");
    (!is_governed).then_some("--rules-never-change")
}

/// A folder for a ledger, a node and their keys.
pub struct LocalNetwork {
    dir: TempDir,
}

impl LocalNetwork {
    pub fn new() -> Self {
        let network = Self {
            dir: tempfile::tempdir().unwrap(),
        };
        keys::generate(Path::new(&network.path("log.key"))).unwrap();
        network
    }

    pub fn path(&self, name: &str) -> String {
        self.dir.path().join(name).to_str().unwrap().into()
    }

    /// LeRobot's fixture as `save_pretrained` leaves a policy, with a tokenizer of a few words.
    pub fn lerobot_folder(&self) -> String {
        let folder = self.path("lerobot");
        fs::create_dir(&folder).unwrap();
        let fixture = root().join("tests/fixtures/smolvla_tiny");
        for (from, to) in [
            ("policy_config.json", "config.json"),
            ("vlm_config.json", "vlm_config.json"),
            ("weights.safetensors", "model.safetensors"),
        ] {
            fs::copy(fixture.join(from), Path::new(&folder).join(to)).unwrap();
        }
        name_cameras(&Path::new(&folder).join("config.json"));
        let tokenizer = json!({
            "version": "1.0", "truncation": null, "padding": null, "added_tokens": [],
            "normalizer": {"type": "Lowercase"}, "pre_tokenizer": {"type": "Whitespace"},
            "post_processor": null, "decoder": null,
            "model": {
                "type": "WordLevel", "unk_token": "?",
                "vocab": {"?": 0, "pick": 11, "up": 12, "the": 13, "red": 14, "cube": 15, "and": 16, "place": 17, "it": 18}
            }
        });
        let file = Path::new(&folder).join("tokenizer.json");
        fs::write(file, tokenizer.to_string()).unwrap();
        folder
    }

    /// The command that founds a network in `ledger`.
    pub fn founding(&self, more: &[&str]) -> Vec<String> {
        let mut arguments = vec!["aggregator".into(), "init".into(), self.path("ledger")];
        arguments.extend(["--name".into(), "own-policy".into()]);
        arguments.extend(["--key".into(), self.path("log.key")]);
        arguments.extend(more.iter().map(|word| (*word).to_owned()));
        arguments.extend(unless_governed(more).map(str::to_owned));
        arguments
    }

    /// Founds a network of one node. A round lasts a minute at most, unless `more` has `--commit-minutes` and `--submit-minutes`.
    #[track_caller]
    pub fn found(&self, more: &[&str]) -> String {
        let node = keys::generate(Path::new(&self.path("node.key"))).unwrap();
        let node = format!("node={node}");
        let windows = match more.contains(&"--commit-minutes") {
            true => &[][..],
            false => &["--commit-minutes", "1", "--submit-minutes", "1"],
        };
        let more = [&["--node", &node], windows, more].concat();
        logs(&words(&self.founding(&more)))
    }

    /// Like [`Self::found`], for tests that do not count on a claim: a round takes submissions for five seconds only, so that it is soon over. Its
    /// commitments close when the node has committed, however long a busy machine trains.
    #[track_caller]
    pub fn found_with_short_rounds(&self) {
        let node = keys::generate(Path::new(&self.path("node.key"))).unwrap();
        let mut rules: Value = serde_json::from_str(&prints(&["aggregator", "rules"])).unwrap();
        rules["commit_window_ms"] = 180_000.into();
        rules["submit_window_ms"] = 5_000.into();
        let file = self.path("rules.json");
        fs::write(&file, rules.to_string()).unwrap();
        let node = format!("node={node}");
        logs(&words(&self.founding(&["--node", &node, "--rules", &file])));
    }

    pub fn entries(&self) -> Vec<Entry> {
        verified_entries(Path::new(&self.path("ledger"))).unwrap().0
    }

    /// Waits until so many rounds have closed.
    #[track_caller]
    pub fn closes(&self, rounds: usize) {
        until(format!("{rounds} rounds close"), || {
            let entries = self.entries().into_iter();
            let closed = entries.filter(|entry| matches!(entry.body, Body::RoundClosed(_)));
            closed.count() >= rounds
        });
    }

    pub fn genesis(&self) -> Genesis {
        match self.entries().remove(0).body {
            Body::Genesis(genesis) => genesis,
            other => panic!("{other:?}"),
        }
    }

    /// The policy file that the genesis names.
    pub fn policy(&self) -> PolicyFile {
        let blob = self.genesis().policy.to_string();
        let blobs = Path::new(&self.path("ledger")).join("blobs/sha256");
        policy_file::load(&blobs.join(blob)).unwrap()
    }

    /// All frames of the node's recording, as the policy of `file` makes them into samples.
    pub fn samples(&self, file: &PolicyFile) -> Vec<PreparedSample> {
        let dataset = Dataset::open(root().join(RECORDING)).unwrap();
        prepare_samples(&dataset, file, None).unwrap()
    }

    /// The root of the node's dataset, prepared for `file` under the node's secret.
    pub fn dataset_root(&self, file: &PolicyFile) -> Digest {
        let genesis = self.genesis();
        let dir = tempfile::tempdir().unwrap();
        let policy = dir.path().join("policy.safetensors");
        policy_file::save(&file.policy, &file.tokenizer, None, &policy).unwrap();
        let recording = OpenRecording::open(&root().join(RECORDING), &policy, None).unwrap();
        let maker = recording.maker();
        let secrets = Secrets::of_registered(Path::new(&self.path("state"))).unwrap();
        let by = EvaluationSetSpec {
            network: genesis.network_id(),
            mode: genesis.mode,
            frames: genesis.rules.evaluation_frames,
            secret: secrets.newest().unwrap().clone(),
        };
        let spec = EvalSpec::decode(&genesis.evaluation).unwrap();
        let samples = recording.samples(&maker);
        let set = EvaluationSet::prepare(&recording, &samples, &spec, by, dir.path()).unwrap();
        set.commitment.root
    }

    /// Runs `zk0 node join`, with an aggregator and a prover that end afterwards.
    #[track_caller]
    pub fn join(&self, rounds: u64, more: &[&str]) -> Output {
        self.served(|aggregator, prover, network| {
            let joining = self.joining([aggregator, prover, network], rounds, more);
            zk0(&words(&joining)).output().unwrap()
        })
    }

    /// The command that takes part in `rounds` rounds of this aggregator, by this prover, in this network.
    pub fn joining(&self, of: [&str; 3], rounds: u64, more: &[&str]) -> Vec<String> {
        let [aggregator, prover, network] = of;
        let rounds = rounds.to_string();
        let (key, state) = (self.path("node.key"), self.path("state"));
        let mut arguments = vec!["node", "join"];
        arguments.extend(["--aggregator", aggregator, "--prover", prover]);
        arguments.extend(["--network", network, "--key", &key, "--dataset", RECORDING]);
        arguments.extend(["--state", &state, "--rounds", &rounds]);
        arguments.extend(more);
        arguments.into_iter().map(str::to_owned).collect()
    }

    /// A prover that serves until it is dropped.
    pub fn prover(&self) -> Prover {
        self.prover_with(None)
    }

    /// A prover that serves until it is dropped, over TLS if there is a certificate.
    pub fn prover_with(&self, certificate: Option<Arc<ServerCertificate>>) -> Prover {
        Prover::start(NoProver, 4, "127.0.0.1:0", certificate)
    }

    /// Runs something with an aggregator and a prover, which end afterwards. It gets their addresses, and the network's id.
    pub fn served<T>(&self, run: impl FnOnce(&str, &str, &str) -> T) -> T {
        let runtime = Runtime::new().unwrap();
        let key = keys::read(Path::new(&self.path("log.key"))).unwrap();
        let ledger = self.path("ledger");
        let config = Config {
            rounds: None,
            min_nodes: 1,
        };
        let clock = Arc::new(SystemClock);
        let aggregator = Aggregator::open(Path::new(&ledger), None, key, clock, config).unwrap();
        let network = aggregator.state().network().to_string();
        let (urls, services) = runtime.block_on(async {
            let listener = || async { TcpListener::bind("127.0.0.1:0").await.unwrap() };
            let (first, second) = (listener().await, listener().await);
            let url = |listener: &TcpListener| format!("http://{}", listener.local_addr().unwrap());
            let urls = (url(&first), url(&second));
            let prover = ProvingService::start(NoProver, 4, Pace::of_cores(2));
            let services = [
                tokio::spawn(async move {
                    let service = Service::new(aggregator);
                    service.serve(first, std::future::pending()).await.unwrap();
                }),
                tokio::spawn(async move {
                    prover.serve(second, std::future::pending()).await.unwrap();
                }),
            ];
            (urls, services)
        });
        let output = run(&urls.0, &urls.1, &network);
        services.iter().for_each(|service| service.abort());
        // All tasks that still hold the database end here.
        drop(runtime);
        let (ledger, key) = (self.path("ledger"), self.path("log.key"));
        until("the aggregator lets go of its ledger", || {
            let key = keys::read(Path::new(&key)).unwrap();
            Ledger::open(Path::new(&ledger), None, key).is_ok()
        });
        output
    }

    /// The log of [`Self::join`], which has to succeed.
    #[track_caller]
    pub fn joins(&self, rounds: u64, more: &[&str]) -> String {
        let output = self.join(rounds, more);
        let reported = logged(&output);
        assert!(output.status.success(), "{reported}");
        reported
    }
}

/// A prover on loopback that makes no real proofs.
pub struct Prover {
    pub address: String,
    _runtime: Runtime,
}

impl Prover {
    /// Serves `backend` with a queue of this length, until it is dropped. Its connections break then, as those of a killed process do.
    pub fn start(
        backend: impl Backend,
        queue: usize,
        listen: &str,
        certificate: Option<Arc<ServerCertificate>>,
    ) -> Self {
        let runtime = Runtime::new().unwrap();
        let address = runtime.block_on(async {
            let listener = TcpListener::bind(listen).await.unwrap();
            let address = listener.local_addr().unwrap();
            let prover = ProvingService::start(backend, queue, Pace::of_cores(2));
            let forever = std::future::pending();
            match certificate {
                Some(certificate) => {
                    tokio::spawn(async move {
                        prover
                            .serve_encrypted(listener, &certificate, forever)
                            .await
                    });
                    format!("https://{address}")
                }
                None => {
                    tokio::spawn(async move { prover.serve(listener, forever).await });
                    format!("http://{address}")
                }
            }
        });
        Self {
            address,
            _runtime: runtime,
        }
    }
}

/// The roots of all datasets on the ledger.
pub fn committed(entries: &[Entry]) -> Vec<Digest> {
    let roots = entries.iter().filter_map(|entry| match &entry.body {
        Body::DatasetCommitted(signed) => Some(signed.statement.dataset.root),
        _ => None,
    });
    roots.collect()
}

/// Makes something that is not a proof, at once. As with SP1, two proofs of one claim are different.
pub struct NoProver;

/// How many of these were made. It is of the whole process, so that two services make different ones, too.
static MADE: AtomicU64 = AtomicU64::new(0);

#[tonic::async_trait]
impl Backend for NoProver {
    async fn start(&self) -> Result<(), JobError> {
        Ok(())
    }

    async fn check(&self, _: &GuestInput) -> Result<Execution, JobError> {
        Ok(Execution {
            public_values: Vec::new(),
            cycles: 1,
            gas: 1,
        })
    }

    async fn prove(
        &self,
        _: &GuestInput,
        _: &Execution,
        _: &WaitingClient,
    ) -> Result<Proof, JobError> {
        Ok(Proof {
            bytes: format!("no proof {}", MADE.fetch_add(1, Ordering::SeqCst)).into_bytes(),
            public_values: Vec::new(),
        })
    }
}
