//! `zk0 demo`: a whole federation on one machine. An aggregator, a proving service and the nodes run as processes of their
//! own and speak gRPC over loopback; each node has its own recording. All are honest but the last, which submits the base
//! weights with somebody else's proof. At the end the ledger is audited as an outsider would.

pub mod lazy_node;
mod process;
mod results;

use crate::{audit, keys};
use anyhow::{bail, Context, Result};
use process::{Console, Process};
use std::{
    fs,
    path::{Path, PathBuf},
    time::{Duration, SystemTime},
};
use zk0_circuits::Mode;

/// What to run.
#[derive(Debug, clap::Args)]
pub struct Options {
    /// Rounds to run.
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u64).range(1..=100))]
    rounds: u64,
    /// Nodes, each on its own recording; the last one is lazy.
    #[arg(long, default_value_t = 3, value_parser = clap::value_parser!(u64).range(2..=16))]
    nodes: u64,
    /// How matrix products are proven: direct or checked (see `zk0 aggregator init --help`).
    #[arg(long, default_value = "direct")]
    mode: Mode,
    /// Recordings (LeRobotDataset folders), one per node.
    #[arg(long = "dataset", default_values = [
        "tests/fixtures/datasets/so100_pickplace",
        "tests/fixtures/datasets/so100_stacking",
        "tests/fixtures/datasets/so100_sorting",
        "tests/fixtures/datasets/so101_pickplace",
    ])]
    datasets: Vec<PathBuf>,
    /// A real proof of another claim, which the lazy node passes off as its own.
    #[arg(long, default_value = "tests/fixtures/proof.bin")]
    stolen_proof: PathBuf,
    /// Where results go, in a folder named by the time.
    #[arg(long, default_value = "outputs")]
    out: PathBuf,
}

/// Runs the demo; an error unless the audit holds, somebody was accepted and the lazy node was refused.
pub fn run(options: &Options) -> Result<()> {
    tokio::runtime::Runtime::new()
        .context("starting the runtime")?
        .block_on(federation(options))
}

async fn federation(options: &Options) -> Result<()> {
    let count = options.nodes as usize;
    if options.datasets.len() < count {
        bail!(
            "{count} nodes need {count} recordings, {} given: add --dataset DIR",
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
                "{} is not there: run from the repository's root, or name it by an option",
                path.display()
            );
        }
    }
    let out = options.out.join(timestamp());
    let (network, nodes) = (out.join("network"), out.join("nodes"));
    fs::create_dir_all(&nodes).with_context(|| format!("creating {}", nodes.display()))?;
    let console = Console::new(fs::File::create(out.join("zk0.log")).context("creating the log")?);
    console.say(&format!("results go to {}", out.display()));

    // The prover takes longest to start: it starts first.
    let mut prover = Process::start(
        "prover",
        &["prover", "serve", "--listen", "127.0.0.1:0"],
        &console,
    )?;

    let names: Vec<String> = (1..=count).map(|i| format!("node-{i}")).collect();
    let mut enrol = Vec::new();
    for name in &names {
        let dir = nodes.join(name);
        fs::create_dir_all(&dir)?;
        enrol.push(format!("{name}={}", keys::generate(&dir.join("node.key"))?));
    }
    let log_key = out.join("log.key");
    keys::generate(&log_key)?;
    let mut init = vec![
        "aggregator",
        "init",
        text(&network)?,
        "--name",
        "zk0-demo",
        "--key",
        text(&log_key)?,
    ];
    // One prover serves everybody in turn: leave each node its turn.
    let submit_window = (10 + 15 * count).to_string();
    let mode = options.mode.to_string();
    init.extend(["--submit-minutes", &submit_window, "--mode", &mode]);
    enrol.iter().for_each(|node| init.extend(["--node", node]));
    Process::start("init", &init, &console)?.finish().await?;

    let (rounds, min_nodes) = (options.rounds.to_string(), count.to_string());
    let serve = [
        "aggregator",
        "serve",
        text(&network)?,
        "--key",
        text(&log_key)?,
        "--listen",
        "127.0.0.1:0",
        "--rounds",
        &rounds,
        "--min-nodes",
        &min_nodes,
    ];
    let mut aggregator = Process::start("aggregator", &serve, &console)?;
    let (aggregator_url, prover_url) = (url(&mut aggregator).await?, url(&mut prover).await?);

    let mut joined = Vec::new();
    let id = audit::network_id(&network)?.to_string();
    for (i, (name, dataset)) in names.iter().zip(&options.datasets).enumerate() {
        let dir = nodes.join(name);
        let key = dir.join("node.key");
        let is_lazy = i + 1 == count;
        let mut join = match is_lazy {
            true => vec![
                "demo-lazy-node",
                "--stolen-proof",
                text(&options.stolen_proof)?,
            ],
            false => vec!["node", "join", "--prover", &prover_url],
        };
        join.extend([
            "--aggregator",
            &aggregator_url,
            "--network",
            &id,
            "--key",
            text(&key)?,
            "--dataset",
            text(dataset)?,
            "--state",
            text(&dir)?,
            "--rounds",
            &rounds,
        ]);
        joined.push(Process::start(name, &join, &console)?);
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

    console.say("auditing the ledger as an outsider would");
    let held_out = options.datasets.get(count).filter(|path| path.exists());
    results::finish(
        &out,
        &network,
        &names,
        held_out.map(PathBuf::as_path),
        &console,
    )
}

async fn url(process: &mut Process) -> Result<String> {
    // Setting up the prover takes minutes on a small machine.
    let address = tokio::time::timeout(Duration::from_secs(900), process.address())
        .await
        .context("waiting for a server")??;
    Ok(format!("http://{address}"))
}

fn text(path: &Path) -> Result<&str> {
    path.to_str()
        .with_context(|| format!("the path {} is not UTF-8", path.display()))
}

/// UTC time as `2026-11-21T08-30-00`: sorts by name, safe in file names.
fn timestamp() -> String {
    let now: chrono::DateTime<chrono::Utc> = SystemTime::now().into();
    now.format("%Y-%m-%dT%H-%M-%S").to_string()
}
