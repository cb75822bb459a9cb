//! `zk0 node`: take part in a network.

use crate::keys;
use anyhow::{Context, Result};
use std::{fs, path::PathBuf};
use tokio::runtime::Runtime;
use zk0_circuits::Digest;
use zk0_prover::{
    node::Node,
    participant::{Conduct, Participant, Training},
    service::ProvingClient,
};

/// What to do.
#[derive(Debug, clap::Subcommand)]
pub enum Command {
    /// Make a node's key and print its identity, which the aggregator's operator enrols.
    Keygen {
        /// Where the key goes.
        file: PathBuf,
    },
    /// Join a network: commit to a recording, then train, prove and submit, round after round.
    Join(Join),
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
    /// The recording: a LeRobotDataset v3.0 folder.
    #[arg(long)]
    dataset: PathBuf,
    /// Where the node keeps its salt, updates and training histories.
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
    /// Do not train: submit the base weights with the proof in this file. For demonstrations; it will be refused.
    #[arg(long, hide = true)]
    lazy_with_proof: Option<PathBuf>,
}

/// Runs the command.
pub fn run(command: &Command) -> Result<()> {
    match command {
        Command::Keygen { file } => {
            println!("{}", keys::generate(file)?);
            Ok(())
        }
        Command::Join(options) => Runtime::new()
            .context("starting the runtime")?
            .block_on(join(options)),
    }
}

async fn join(options: &Join) -> Result<()> {
    fs::create_dir_all(&options.state)
        .with_context(|| format!("creating {}", options.state.display()))?;
    let conduct = match &options.lazy_with_proof {
        None => Conduct::Honest,
        Some(path) => {
            let proof =
                fs::read(path).with_context(|| format!("reading the proof {}", path.display()))?;
            Conduct::Lazy { proof }
        }
    };
    let participant = Participant {
        dataset: options.dataset.clone(),
        state: options.state.clone(),
        training: Training {
            steps: options.steps,
            batch_size: options.batch_size,
            learning_rate: options.learning_rate,
        },
        conduct,
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
