//! `zk0 node`: take part in a network.

use crate::{dataset::RecordingName, frames::CacheOptions, keys};
use anyhow::{bail, Context, Result};
use std::{
    fs,
    path::{Path, PathBuf},
};
use tokio::runtime::Runtime;
use zk0_circuits::{claim::challenge::MAX_EVAL_SAMPLES, Digest, EvalSpec, Mode};
use zk0_node::{client::Node, participant::Participant, turn::Training};
use zk0_prover::{
    estimate as prover, execute::Executor, options::Resources, service::ProvingClient,
};
use zk0_smolvla::{
    adaptive::{Adaptation, Boost},
    fixed_point::dims,
    policy_file, Profile,
};

/// What to do.
#[derive(Debug, clap::Subcommand)]
#[allow(clippy::large_enum_variant)] // There is one, for as long as the program runs.
pub enum Command {
    /// Make a node's key and print its identity, which the aggregator's operator enrols.
    Keygen {
        /// Where the key goes.
        file: PathBuf,
    },
    /// Say what a claim will cost on this machine, before anything is spent: cycles, memory, time.
    Estimate(Estimate),
    /// Join a network: commit to a recording, then train, prove and submit, round after round.
    Join(Join),
}

/// `zk0 node estimate`.
#[derive(Debug, clap::Args)]
pub struct Estimate {
    /// The model: micro, tiny, full (the published size), or a network's policy file.
    #[arg(long, default_value = "micro")]
    model: String,
    /// How matrix products are proven: direct or checked, as the network says.
    #[arg(long, default_value = "checked")]
    mode: Mode,
    /// Samples evaluated per claim, as the network's rules say.
    #[arg(long, default_value_t = 4, value_parser = clap::value_parser!(u32).range(1..=MAX_EVAL_SAMPLES as i64))]
    samples: u32,
    /// The recording that the claims will be about (LeRobotDataset folder, or hub:owner/name[@revision]): checked to fit the model and the samples.
    #[arg(long)]
    dataset: Option<RecordingName>,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

/// `zk0 node join`.
#[derive(Debug, clap::Args)]
pub struct Join {
    /// The aggregator, such as http://127.0.0.1:7071.
    #[arg(long)]
    aggregator: String,
    /// The proving service, such as http://127.0.0.1:7072.
    #[arg(long)]
    prover: String,
    /// The network's id, as its operator published it: nothing else is believed.
    #[arg(long)]
    network: Digest,
    /// The node's key.
    #[arg(long)]
    key: PathBuf,
    /// The recording: a LeRobotDataset folder, or hub:owner/name[@revision] on the Hugging Face Hub.
    #[arg(long)]
    dataset: RecordingName,
    /// Where the node keeps the policy, its salt, updates and training histories.
    #[arg(long)]
    state: PathBuf,
    /// Rounds to take part in.
    #[arg(long, default_value_t = 1)]
    rounds: u64,
    /// Optimiser steps per round.
    #[arg(long, default_value_t = 600)]
    steps: usize,
    /// Samples per step.
    #[arg(long, default_value_t = 32)]
    batch_size: usize,
    /// Learning rate.
    #[arg(long, default_value_t = 2e-3)]
    learning_rate: f64,
    /// FedProx: weight of the pull towards the base weights of the round.
    #[arg(long, default_value_t = 0.0, value_name = "MU")]
    fedprox_mu: f64,
    /// Let mu and the learning rate follow the loss of the rounds' base weights on this recording: four fifths of both where it
    /// stalls over three rounds, a tenth more where it grows by 5 %.
    #[arg(long)]
    follow_losses: bool,
    /// Raise the learning rate by this factor, 1 to 10, in rounds that begin at more than twice the average loss so far.
    #[arg(long, value_name = "FACTOR")]
    lr_boost: Option<f64>,
    #[command(flatten)]
    cache: CacheOptions,
}

/// Runs the command.
pub fn run(command: &Command) -> Result<()> {
    match command {
        Command::Keygen { file } => {
            println!("{}", keys::generate(file)?);
            Ok(())
        }
        Command::Estimate(options) => Runtime::new()
            .context("starting the runtime")?
            .block_on(estimate(options)),
        Command::Join(options) => Runtime::new()
            .context("starting the runtime")?
            .block_on(join(options)),
    }
}

async fn estimate(options: &Estimate) -> Result<()> {
    let config = match Profile::from_name(&options.model) {
        Ok(profile) => profile.config(),
        Err(unknown) => match policy_file::load(Path::new(&options.model)) {
            Ok(file) => file.policy.config,
            Err(error) => bail!(
                "{unknown}, and as a policy file {} cannot be read: {error}",
                options.model
            ),
        },
    };
    if let Some(recording) = &options.dataset {
        let dataset = recording.open()?;
        let frames = dataset.len() as u64;
        if frames < options.samples as u64 {
            bail!(
                "{recording} has {frames} frames: no claim over {} samples can be made of it",
                options.samples
            );
        }
        if dataset.cameras().len() > config.cameras {
            bail!(
                "{recording} has {} cameras, the model takes {}",
                dataset.cameras().len(),
                config.cameras
            );
        }
    }
    let spec = EvalSpec::new(dims(&config)?);
    if !options.json {
        eprintln!("counting cycles: executing the program on random weights and samples of these dimensions");
    }
    let machine = Resources::of_this_machine()?;
    let executor = Executor::new().await?;
    let estimate =
        prover::Estimate::of(&executor, &spec, options.mode, options.samples, machine).await?;
    match options.json {
        true => println!("{}", serde_json::to_string(&estimate)?),
        false => print!("{}", table(&options.model, &estimate)),
    }
    Ok(())
}

/// The estimate for people.
fn table(model: &str, estimate: &prover::Estimate) -> String {
    const GIB: f64 = (1u64 << 30) as f64;
    let memory = match estimate.fits() {
        true => "enough",
        false => "NOT ENOUGH: the proof has to be made on another machine",
    };
    format!(
        "a claim over {samples} samples of model {model}, mode {mode}\n\
         \x20 guest cycles     {cycles:.1} million ({gas:.1} million gas)\n\
         \x20 witness          {witness:.1} MB to the proving service, private\n\
         \x20 memory           {needed:.0} GiB for a proof, {free:.1} GiB are free here: {memory}\n\
         \x20 proof            {proof} on {cores} cores, and {start} once to start the service\n\
         the time is computed from the cycles by constants measured on two cores (docs/prove.md, \"How long does it take?\"); after its\n\
         first proof the proving service knows this machine's own\n",
        samples = estimate.samples,
        mode = estimate.mode,
        cycles = estimate.cycles as f64 / 1e6,
        gas = estimate.gas as f64 / 1e6,
        witness = estimate.witness_bytes as f64 / 1e6,
        needed = estimate.memory_needed_bytes as f64 / GIB,
        free = estimate.memory_free_bytes as f64 / GIB,
        proof = duration(estimate.proving_seconds),
        cores = estimate.cores,
        start = duration(estimate.start_seconds),
    )
}

/// `45 s`, `10 min`, `7.3 h`, `2.1 days`.
fn duration(seconds: f64) -> String {
    match seconds {
        s if s < 100.0 => format!("{s:.0} s"),
        s if s < 6000.0 => format!("{:.0} min", s / 60.0),
        s if s < 172_800.0 => format!("{:.1} h", s / 3600.0),
        s => format!("{:.1} days", s / 86_400.0),
    }
}

async fn join(options: &Join) -> Result<()> {
    let boost = options.lr_boost.map(|factor| Boost {
        factor,
        ..Boost::default()
    });
    if let Some(boost) = boost {
        boost.check().context("--lr-boost")?;
    }
    fs::create_dir_all(&options.state)
        .with_context(|| format!("creating {}", options.state.display()))?;
    let participant = Participant {
        dataset: options.dataset.locate()?,
        state: options.state.clone(),
        cache: options
            .cache
            .open_or(|| Ok(options.state.join("prefix-cache")))?,
        training: Training {
            steps: options.steps,
            batch_size: options.batch_size,
            learning_rate: options.learning_rate,
            fedprox_mu: options.fedprox_mu,
            adaptation: Adaptation {
                follow: options.follow_losses,
                boost,
            },
        },
    };
    let mut node = Node::connect(
        options.aggregator.clone(),
        options.network,
        keys::read(&options.key)?,
    )
    .await?;
    let mut prover = ProvingClient::connect(options.prover.clone()).await?;
    Ok(participant
        .run(&mut node, &mut prover, options.rounds)
        .await?)
}
