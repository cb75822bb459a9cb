//! The demo's lazy node: it submits the base weights, with somebody else's proof. The network refuses that.
//!
//! It is a program of the demo. A node of `zk0 node join` cannot do this.

use crate::keys;
use crate::policy::CacheOptions;
use anyhow::{Context, Result};
use sha2::{Digest as _, Sha256};
use std::path::{Path, PathBuf};
use zk0_circuits::{Digest, Disclosure, Losses, Terms, WeightsDigest};
use zk0_files::bounded_file;
use zk0_node::client::Node;
use zk0_node::participant::Participant;
use zk0_node::receipts;
use zk0_node::turn::{Entered, Training};
use zk0_protocol::entries::entry::RoundOpened;
use zk0_protocol::rules::bindings::ExpectedClaim;
use zk0_smolvla::measure::fixed_point::quantise_weights;
use zk0_smolvla::train::adaptive::Adaptation;
use zk0_smolvla::ExpertWeights;

/// Largest proof that is read. A compressed proof has 1.3 MB.
const MAX_PROOF_BYTES: u64 = 16 << 20;

/// What the demo tells its lazy node.
#[derive(Debug, clap::Args)]
pub struct Options {
    /// The aggregator's address.
    #[arg(long)]
    aggregator: String,
    /// The network's id.
    #[arg(long)]
    network: Digest,
    /// The node's key.
    #[arg(long)]
    key: PathBuf,
    /// The recording that it commits to.
    #[arg(long)]
    dataset: PathBuf,
    /// The node's state folder.
    #[arg(long)]
    state: PathBuf,
    /// Rounds to take part in.
    #[arg(long)]
    rounds: u64,
    /// A real proof of another claim.
    #[arg(long)]
    stolen_proof: PathBuf,
    #[command(flatten)]
    cache: CacheOptions,
}

/// Takes part in the rounds. The demo expects a refusal, so a refusal is logged and is not an error.
pub fn run(options: &Options) -> Result<()> {
    tokio::runtime::Runtime::new()
        .context("starting the runtime")?
        .block_on(take_part(options))
}

async fn take_part(options: &Options) -> Result<()> {
    let proof = bounded_file::read(&options.stolen_proof, MAX_PROOF_BYTES)
        .with_context(|| format!("reading the proof {}", options.stolen_proof.display()))?;
    let participant = Participant {
        dataset: options.dataset.clone(),
        state: options.state.clone(),
        cache: options
            .cache
            .open_or(|| Ok(options.state.join("prefix-cache")))?,
        // It never trains.
        training: Training {
            steps: 0,
            batch_size: 1,
            learning_rate: 0.0,
            fedprox_mu: 0.0,
            adaptation: Adaptation {
                follow: false,
                boost: None,
            },
        },
    };
    let mut node = Node::connect(
        options.aggregator.clone(),
        options.network,
        keys::read(&options.key)?,
    )
    .await?;
    let entered = participant.enter(&mut node).await?;
    let mut next = 0;
    for _ in 0..options.rounds {
        let opened = node.wait_for_round(next).await?;
        next = opened.round + 1;
        play(&mut node, &entered, &opened, &options.state, &proof).await?;
        node.wait_for_close(opened.round).await?;
    }
    Ok(())
}

async fn play(
    node: &mut Node,
    entered: &Entered,
    opened: &RoundOpened,
    state: &Path,
    proof: &[u8],
) -> Result<()> {
    let (round, rules) = (opened.round, &opened.rules);
    let file = node
        .download(&opened.base.blob, rules.max_base_bytes())
        .await?;
    let update = ExpertWeights::from_safetensors(&entered.config, &file)?;
    let file = update.to_safetensors()?;
    let digest = WeightsDigest {
        blob: Digest(Sha256::digest(&file).into()),
        quantised: quantise_weights(&entered.spec, &update)?.digest(node.genesis().mode),
    };
    node.upload(round, &file).await?;
    let root = entered.recording.commitment.root;
    let (challenge, receipt) = node.commit(round, &root, &digest).await?;
    receipts::keep(state, receipt)?;
    let expected = ExpectedClaim {
        terms: Terms {
            network: *node.network(),
            round,
            node: node.id(),
            dataset: entered.recording.commitment,
            evaluation: opened.evaluation,
            base: opened.base,
            update: digest,
            challenge,
            eval_samples: rules.eval_samples,
            min_improvement_bps: rules.min_improvement_bps,
        },
        disclosure: rules.disclosure,
    };
    // It claims that the loss is half of what it was.
    let losses = match expected.disclosure {
        Disclosure::Nothing => Losses::Hidden,
        Disclosure::Losses => Losses::Disclosed {
            before: 2 << 24,
            after: 1 << 24,
            elements: 1,
        },
    };
    let decision = node.submit(expected.with(losses), proof.to_vec()).await?;
    receipts::keep(state, decision.receipt)?;
    match decision.refusal {
        Some(reason) => tracing::warn!("round {round}: refused: {reason}"),
        None => tracing::info!("round {round}: accepted"),
    }
    Ok(())
}
