//! `zk0 aggregator`: found a network, enrol nodes, run rounds.

use crate::{
    calibration::{calibrated, samples},
    dataset::RecordingName,
    governance::read_rules,
    keys,
    policy_source::PolicySource,
};
use anyhow::{bail, Context, Result};
use std::{net::SocketAddr, path::PathBuf, sync::Arc, time::Duration};
use tokio::{net::TcpListener, runtime::Runtime, task::JoinHandle};
use zk0_aggregator::{
    aggregator::{Aggregator, Config},
    clock::{Clock, SystemClock},
    cosigning::Witnesses,
    http,
    log_server::LogServer,
    service::Service,
};
use zk0_circuits::{
    program::verifying_key, spec::EvalSpec, statement::Mode, NodeId, WeightsDigest,
};
use zk0_ledger::{
    entry::{Body, Genesis, NodeEnrolled},
    folder,
    governance::{Governance, Governor},
    log::Ledger,
    rules::{CreditRule, Disclosure, EnrolmentRule, Participation, Rules, Strategy},
};
use zk0_smolvla::{fixed_point::quantise_weights, Profile};
use zk0_verifier::blob_digest;

/// What to do.
#[derive(Debug, clap::Subcommand)]
pub enum Command {
    /// Make a signing key for the log.
    Keygen {
        /// Where the key goes.
        file: PathBuf,
    },
    /// Print rules as JSON: edit them, and found a network with them (`init --rules`).
    Rules(CommonRules),
    /// Found a network: its rules, its initial policy, its first nodes.
    Init(Init),
    /// Enrol a node in a network that is not being served at the moment.
    Enrol {
        /// The ledger's directory.
        dir: PathBuf,
        /// The log's signing key.
        #[arg(long)]
        key: PathBuf,
        /// NAME=IDENTITY, as `zk0 node keygen` prints it.
        #[arg(long = "node", required = true)]
        nodes: Vec<Enrolment>,
    },
    /// Serve a network: open rounds, verify contributions, aggregate.
    Serve(Serve),
}

/// `zk0 aggregator init`.
#[derive(Debug, clap::Args)]
pub struct Init {
    /// The ledger's directory; must not exist.
    dir: PathBuf,
    /// The network's name, also the origin of its checkpoints.
    #[arg(long)]
    name: String,
    /// The log's signing key.
    #[arg(long)]
    key: PathBuf,
    /// Nodes to enrol: NAME=IDENTITY.
    #[arg(long = "node")]
    nodes: Vec<Enrolment>,
    /// How matrix products are proven: direct (the guest multiplies) or checked (it checks products with random
    /// coefficients, and verifiers project the weights; the only way at the published size).
    #[arg(long, default_value = "direct")]
    mode: Mode,
    /// Seed of the initial policy's random weights.
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Recordings (LeRobotDataset folders, or hub:owner/name[@revision]) that the ranges of the fixed-point evaluation are chosen from, with eightfold
    /// headroom. Without any, ranges are the default ones.
    #[arg(long = "calibrate", value_name = "DATASET")]
    calibrate: Vec<RecordingName>,
    /// The network's rules, all of them, from a JSON file (`zk0 aggregator rules` prints one to begin with) instead of the
    /// options below.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["min_dataset_samples", "eval_samples", "min_improvement_bps", "max_weight_samples", "hide_losses", "commit_minutes", "submit_minutes", "governors"])]
    rules: Option<PathBuf>,
    #[command(flatten)]
    common: CommonRules,
}

/// The rules that most networks set.
#[derive(Debug, clap::Args)]
pub struct CommonRules {
    /// Fewest samples a dataset may have.
    #[arg(long, default_value_t = 64)]
    min_dataset_samples: u64,
    /// Samples evaluated per claim.
    #[arg(long, default_value_t = 4)]
    eval_samples: u32,
    /// Least improvement of the loss, in basis points (100 are 1 %).
    #[arg(long, default_value_t = 100)]
    min_improvement_bps: u32,
    /// Most samples a contribution counts for.
    #[arg(long, default_value_t = 10_000)]
    max_weight_samples: u64,
    /// Keep the losses out of the proofs' public values.
    #[arg(long)]
    hide_losses: bool,
    /// Minutes from a round's opening in which updates may be committed.
    #[arg(long, default_value_t = 10)]
    commit_minutes: u64,
    /// Minutes from a round's opening in which claims may be submitted.
    #[arg(long, default_value_t = 60)]
    submit_minutes: u64,
    /// Who governs, each with one vote: NAME=IDENTITY, as `zk0 governance keygen` prints it. Half of them make a quorum, more
    /// than half of the votes decide, a third stops it; three days to vote, one to veto. Without any, the rules never change.
    #[arg(long = "governor")]
    governors: Vec<Enrolment>,
}

/// `zk0 aggregator serve`.
#[derive(Debug, clap::Args)]
pub struct Serve {
    /// The ledger's directory.
    dir: PathBuf,
    /// The log's signing key.
    #[arg(long)]
    key: PathBuf,
    /// Address to listen on; port 0 takes a free one. Traffic is not encrypted: put a TLS proxy before it.
    #[arg(long, default_value = "127.0.0.1:7071")]
    listen: SocketAddr,
    /// Rounds to run before no more is opened.
    #[arg(long, default_value_t = u64::MAX, hide_default_value = true)]
    rounds: u64,
    /// Nodes that must have committed to a dataset before a round opens.
    #[arg(long, default_value_t = 1)]
    min_nodes: usize,
    /// The witnesses and the quorum without which nothing is published (a C2SP tlog-policy file, with the witnesses'
    /// addresses). The ledger's directory remembers it.
    #[arg(long)]
    policy: Option<PathBuf>,
    /// How long a witness may take to answer, in seconds.
    #[arg(long, default_value_t = 5)]
    witness_seconds: u64,
    /// Serve the log's files over HTTP too, on this address (C2SP tlog-tiles).
    #[arg(long)]
    log_listen: Option<SocketAddr>,
}

/// A node to enrol, `NAME=IDENTITY`.
#[derive(Clone, Debug)]
pub struct Enrolment {
    /// A name for people.
    pub name: String,
    /// Its key.
    pub node: NodeId,
}

impl std::str::FromStr for Enrolment {
    type Err = anyhow::Error;

    fn from_str(text: &str) -> Result<Self> {
        let Some((name, node)) = text.split_once('=') else {
            bail!("'{text}' is not NAME=IDENTITY");
        };
        Ok(Self {
            name: name.into(),
            node: node.parse()?,
        })
    }
}

/// Runs the command.
pub fn run(command: &Command) -> Result<()> {
    match command {
        Command::Keygen { file } => {
            println!("{}", keys::generate(file)?);
            Ok(())
        }
        Command::Rules(common) => {
            println!("{}", serde_json::to_string_pretty(&common.rules()?)?);
            Ok(())
        }
        Command::Init(options) => init(options),
        Command::Enrol { dir, key, nodes } => {
            let mut ledger = Ledger::open(dir, None, keys::read(key)?)?;
            ledger.watch_clock(SystemClock.now_ms(), || SystemClock.steady())?;
            enrol(&mut ledger, nodes)
        }
        Command::Serve(options) => serve(options),
    }
}

fn init(options: &Init) -> Result<()> {
    let key = keys::read(&options.key)?;
    let file = PolicySource::Random(Profile::Micro, options.seed).load()?;
    let policy = &file.policy;
    let mut policy_file = Vec::new();
    file.write(&mut policy_file)?;
    let initial_file = policy.expert.to_safetensors()?;
    let spec = match options.calibrate.as_slice() {
        [] => EvalSpec::micro(),
        recordings => {
            let samples = samples(&file, recordings, usize::MAX)?;
            calibrated(&policy.config, &policy.expert, &samples)?
        }
    };
    let genesis = Genesis {
        name: options.name.clone(),
        log_key: key.verifying_key().to_bytes(),
        nonce: keys::random()?,
        rules: match &options.rules {
            Some(file) => read_rules(file)?,
            None => options.common.rules()?,
        },
        program: verifying_key(options.mode).to_vec(),
        mode: options.mode,
        evaluation: spec.encode(),
        policy: blob_digest(&policy_file),
        initial: WeightsDigest {
            blob: blob_digest(&initial_file),
            quantised: quantise_weights(&spec, &policy.expert)?.digest(options.mode),
        },
    };
    let (mut ledger, _) = Ledger::create(&options.dir, genesis, key, SystemClock.now_ms())?;
    for file in [policy_file, initial_file] {
        ledger.blobs().put(&file)?;
    }
    tracing::info!(
        "founded network {} ({})",
        ledger.state().network(),
        options.name
    );
    enrol(&mut ledger, &options.nodes)
}

impl CommonRules {
    fn governance(&self) -> Governance {
        const DAY_MS: u64 = 24 * 3_600_000;
        if self.governors.is_empty() {
            return Governance::none();
        }
        let governor = |Enrolment { name, node }: &Enrolment| Governor {
            key: *node,
            name: name.clone(),
            weight: 1,
        };
        let mut governors: Vec<_> = self.governors.iter().map(governor).collect();
        governors.sort_by_key(|governor| governor.key);
        Governance {
            governors,
            credits_per_vote: 0,
            max_node_votes: 0,
            quorum_bps: 5000,
            threshold_bps: 5000,
            veto_bps: 3333,
            voting_ms: 3 * DAY_MS,
            time_lock_ms: DAY_MS,
        }
    }

    fn rules(&self) -> Result<Rules> {
        let minutes = |count: u64| {
            count
                .checked_mul(60_000)
                .context("a window of so many minutes is no window")
        };
        Ok(Rules {
            min_dataset_samples: self.min_dataset_samples,
            eval_samples: self.eval_samples,
            min_improvement_bps: self.min_improvement_bps,
            max_weight_samples: self.max_weight_samples,
            disclosure: if self.hide_losses {
                Disclosure::Nothing
            } else {
                Disclosure::Losses
            },
            commit_window_ms: minutes(self.commit_minutes)?,
            submit_window_ms: minutes(self.submit_minutes)?,
            max_update_bytes: 1 << 20,
            max_proof_bytes: 2 << 20,
            max_update_norm_bps: 0,
            strategy: Strategy::FedAvg,
            participation: Participation::All,
            enrolment: EnrolmentRule::Operator,
            credits: CreditRule {
                bps_samples_per_credit: 1000,
                max_per_contribution: 10_000,
                dispute_window_ms: 7 * 24 * 3_600_000,
            },
            witness_policy: String::new(),
            governance: self.governance(),
        })
    }
}

fn enrol(ledger: &mut Ledger, nodes: &[Enrolment]) -> Result<()> {
    for Enrolment { name, node } in nodes {
        let enrolled = NodeEnrolled {
            node: *node,
            name: name.clone(),
        };
        ledger
            .append(SystemClock.now_ms(), Body::NodeEnrolled(enrolled))
            .with_context(|| format!("enrolling {name}"))?;
        tracing::info!("enrolled {name} ({node})");
    }
    Ok(())
}

/// Starts serving the log's files, if that is wanted.
async fn log_files(options: &Serve) -> Result<Option<JoinHandle<()>>> {
    let Some(listen) = options.log_listen else {
        return Ok(None);
    };
    let listener = TcpListener::bind(listen)
        .await
        .with_context(|| format!("listening on {listen}"))?;
    tracing::info!("log on http://{}", listener.local_addr()?);
    let server = Arc::new(LogServer::new(&options.dir));
    let limits = http::Limits::default();
    Ok(Some(tokio::spawn(http::serve(
        listener,
        server,
        limits,
        std::future::pending(),
    ))))
}

fn serve(options: &Serve) -> Result<()> {
    let config = Config {
        rounds: Some(options.rounds).filter(|rounds| *rounds != u64::MAX),
        min_nodes: options.min_nodes,
    };
    let aggregator = Aggregator::open(
        &options.dir,
        None,
        keys::read(&options.key)?,
        Arc::new(SystemClock),
        config,
    )?;
    let ruled = aggregator.state().rules().witnesses();
    let ruled = ruled.map_err(anyhow::Error::msg)?;
    let policy = match &options.policy {
        Some(_) if ruled.wants_witnesses() => {
            bail!("this network's rules name its witnesses: leave --policy out")
        }
        None if ruled.wants_witnesses() => ruled,
        Some(path) => crate::ledger::read_policy(path)?,
        None => folder::read_policy(&options.dir)?,
    };
    if !policy.wants_witnesses() && options.policy.is_some() {
        folder::write_policy(&options.dir, &policy)?;
    }
    Runtime::new()
        .context("starting the runtime")?
        .block_on(async {
            let listen = options.listen;
            let listener = TcpListener::bind(listen)
                .await
                .with_context(|| format!("listening on {listen}"))?;
            let address = listener.local_addr()?;
            let network = *aggregator.state().network();
            let mut service = Service::new(aggregator);
            if policy.wants_witnesses() {
                let witnesses =
                    Witnesses::new(policy, Duration::from_secs(options.witness_seconds))?;
                service = service.witnessed(witnesses).await?;
            }
            tracing::info!(listening = %address, "aggregator of network {network} on {address}");
            let log = log_files(options).await?;
            let served = service.serve(listener, crate::interrupted()).await;
            if let Some(log) = log {
                log.abort();
            }
            served.context("the aggregator")
        })
}
