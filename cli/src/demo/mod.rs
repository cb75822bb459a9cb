//! `zk0 demo`: a whole network on one machine, as processes: an aggregator, a proving service, and nodes with their own recordings. The
//! last node submits the base weights with another node's proof. At the end the ledger is audited, as an outsider would do it.

mod global_losses;
pub mod lazy_node;
mod process;
mod results;

use crate::keys;
use crate::network::make_state;
use anyhow::{bail, Context, Result};
use global_losses::EvaluationRecording;
use process::{ChildProcess, Console};
use std::ffi::OsStr;
use std::fs;
use std::path::PathBuf;
use std::time::{Duration, SystemTime};
use zk0_audit::verified_entries::network_id;
use zk0_circuits::Mode;

/// Networks should ask for more (docs/samples.md), but each sample makes a proof longer.
const EVAL_SAMPLES: &str = "6";
const CONFIDENCE: &str = "95%";

const LEARNING_RATE: &str = "1e-3";

/// What to run.
#[derive(Debug, clap::Args)]
pub struct DemoOptions {
    /// Run this many rounds.
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u64).range(1..=100))]
    rounds: u64,
    /// Run this many nodes, each with its own recording. The last one cheats.
    #[arg(long, default_value_t = 3, value_parser = clap::value_parser!(u64).range(2..=16))]
    nodes: u64,
    /// How the evaluation is proven: direct or succinct. `zk0 aggregator init --help` explains them, and what each shows the
    /// prover. Without this option, the demo takes the mode that costs fewer cycles for its policy, and states which.
    #[arg(long)]
    mode: Option<Mode>,
    /// A recording for a node (a LeRobotDataset folder). Repeat the option to give each node one. If there are more, the
    /// network evaluates the result of each round on the last one, which no node has seen.
    #[arg(long = "dataset", default_values = [
        "tests/fixtures/datasets/so100_pickplace",
        "tests/fixtures/datasets/so100_stacking",
        "tests/fixtures/datasets/so100_sorting_two",
        "tests/fixtures/datasets/so100_sorting_four",
    ])]
    datasets: Vec<PathBuf>,
    /// A real proof of another claim. The node that cheats submits it as its own.
    #[arg(long, default_value = "tests/fixtures/proof.bin")]
    stolen_proof: PathBuf,
    /// Honest nodes train this many steps in a round. The more, the surer their claims pass, and the further their weights drift apart.
    #[arg(long, default_value_t = 800)]
    steps: usize,
    /// Train and prove on this device: cpu, or cuda for an NVIDIA GPU (only builds by `make cuda`).
    #[arg(long, default_value = "cpu", value_parser = ["cpu", "cuda"])]
    device: String,
    /// Write the results below this folder, into a folder that is named by the time.
    #[arg(long, default_value = "outputs")]
    out: PathBuf,
}

/// Runs the demo. It fails if the audit fails, no contribution is accepted, or the cheat is not refused.
pub async fn run(options: &DemoOptions) -> Result<()> {
    let count = options.nodes as usize;
    if options.datasets.len() < count {
        bail!(
            "{count} nodes need {count} recordings, and there are {}: add --dataset DIR",
            options.datasets.len()
        );
    }
    for path in options
        .datasets
        .iter()
        .take(count)
        .chain([&options.stolen_proof])
    {
        if !path.exists() {
            bail!(
                "{} does not exist: run this in the repository's folder, or name the file by an option",
                path.display()
            );
        }
    }
    let out = options.out.join(timestamp());
    let (network, nodes) = (out.join("network"), out.join("nodes"));
    fs::create_dir_all(&nodes).with_context(|| format!("creating {}", nodes.display()))?;
    let console = Console::new(fs::File::create(out.join("zk0.log")).context("creating the log")?);
    console.tell(&format!("the results go to {}", out.display()));

    let start = |name: &str, command: &str, options: &[(&str, &dyn AsRef<OsStr>)]| {
        ChildProcess::start(name, command, options, &console)
    };
    let free_port = ("--listen", &"127.0.0.1:0" as &dyn AsRef<OsStr>);
    // The prover takes longest to start.
    let device = ("--device", &options.device as &dyn AsRef<OsStr>);
    let mut prover = start("prover", "prover serve", &[free_port, device])?;

    let names: Vec<String> = (1..=count).map(|i| format!("node-{i}")).collect();
    let mut enrol = Vec::new();
    for name in &names {
        let dir = nodes.join(name);
        make_state(&dir)?;
        enrol.push(format!("{name}={}", keys::generate(&dir.join("node.key"))?));
    }
    let log_key = out.join("log.key");
    keys::generate(&log_key)?;
    // One prover serves all nodes in turn.
    let submit_minutes = (10 + 15 * count).to_string();
    let mode = options.mode.map(|mode| mode.to_string());
    let mut init: Vec<(&str, &dyn AsRef<OsStr>)> = vec![
        ("", &network),
        ("--name", &"zk0-demo"),
        ("--key", &log_key),
        ("--submit-minutes", &submit_minutes),
        ("--min-eval-samples", &EVAL_SAMPLES),
        ("--confidence", &CONFIDENCE),
    ];
    let first = options.datasets.first();
    init.extend(first.map(|path| ("--recordings-like", path as _)));
    init.extend(enrol.iter().map(|node| ("--node", node as _)));
    init.extend(mode.iter().map(|mode| ("--mode", mode as _)));
    // No node has this recording. Each round's result is measured on it.
    let unseen = options.datasets[count..].last();
    let unseen = unseen.filter(|path| path.exists());
    init.extend(unseen.map(|path| ("--public-recording", path as _)));
    // The demo ends before a vote could.
    init.push(("", &"--rules-never-change"));
    start("init", "aggregator init", &init)?.finish().await?;

    let (rounds, min_nodes) = (options.rounds.to_string(), count.to_string());
    let steps = options.steps.to_string();
    let serve: [(&str, &dyn AsRef<OsStr>); 5] = [
        ("", &network),
        ("--key", &log_key),
        free_port,
        ("--rounds", &rounds),
        ("--min-nodes", &min_nodes),
    ];
    let mut aggregator = start("aggregator", "aggregator serve", &serve)?;
    let (aggregator_url, prover_url) = (url(&mut aggregator).await?, url(&mut prover).await?);

    let mut joined = Vec::new();
    let id = network_id(&network)?.to_string();
    for (i, (name, dataset)) in names.iter().zip(&options.datasets).enumerate() {
        let dir = nodes.join(name);
        let key = dir.join("node.key");
        let (command, own): (_, (&str, &dyn AsRef<OsStr>)) = if i + 1 == count {
            ("demo-lazy-node", ("--stolen-proof", &options.stolen_proof))
        } else {
            ("node join", ("--prover", &prover_url))
        };
        let mut join: Vec<(&str, &dyn AsRef<OsStr>)> = vec![
            own,
            ("--aggregator", &aggregator_url),
            ("--network", &id),
            ("--key", &key),
            ("--dataset", dataset),
            ("--state", &dir),
            ("--rounds", &rounds),
        ];
        if i + 1 < count {
            join.extend([
                device,
                ("--steps", &steps as &dyn AsRef<OsStr>),
                ("--learning-rate", &LEARNING_RATE),
            ]);
        }
        joined.push(start(name, command, &join)?);
    }
    let everybody = async {
        for node in &mut joined {
            node.finish().await?;
        }
        anyhow::Ok(())
    };
    tokio::select! {
        done = everybody => done?,
        error = aggregator.ended() => return Err(error),
        error = prover.ended() => return Err(error),
    }
    prover.stop().await;
    aggregator.stop().await;

    console.tell("the ledger is audited, as an outsider would do it");
    let own = options.datasets.iter().zip(&names).enumerate();
    let own = own.map(|(number, (path, name))| EvaluationRecording {
        path: path.clone(),
        node: Some(name.clone()),
        trains: number + 1 < count,
    });
    let unseen = unseen.map(|path| EvaluationRecording {
        path: path.clone(),
        node: None,
        trains: false,
    });
    let recordings: Vec<_> = own.chain(unseen).collect();
    results::finish(&out, &network, &names, &recordings, &console)
}

async fn url(process: &mut ChildProcess) -> Result<String> {
    // A small machine takes minutes.
    let address = tokio::time::timeout(Duration::from_secs(900), process.address())
        .await
        .context("waiting for a server")??;
    Ok(format!("http://{address}"))
}

/// Sorts by name, and is safe in file names: `2026-11-21T08-30-00`.
fn timestamp() -> String {
    let now: chrono::DateTime<chrono::Utc> = SystemTime::now().into();
    now.format("%Y-%m-%dT%H-%M-%S").to_string()
}
