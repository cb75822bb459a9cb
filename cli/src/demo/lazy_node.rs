//! The demo's lazy node submits the base weights with another node's proof. The network refuses that. `zk0 node join` cannot do this.

use crate::network::Membership;
use anyhow::{Context, Result};
use std::path::PathBuf;
use zk0_circuits::{Disclosure, Losses};
use zk0_files::bounded_file;
use zk0_node::client::NodeClient;
use zk0_node::error::ParticipantError;
use zk0_node::turn::Turn;
use zk0_protocol::entries::refusal::Refusal;

/// A compressed proof has 1.3 MB.
const MAX_PROOF_BYTES: u64 = 16 << 20;

/// What the demo tells its lazy node.
#[derive(Debug, clap::Args)]
pub struct LazyNodeOptions {
    #[command(flatten)]
    member: Membership,
    /// A real proof of another claim.
    #[arg(long)]
    stolen_proof: PathBuf,
}

/// Takes part in the rounds. The expected refusal is only logged.
pub async fn run(options: &LazyNodeOptions) -> Result<()> {
    let proof = bounded_file::read(&options.stolen_proof, MAX_PROOF_BYTES)
        .with_context(|| format!("reading the proof {}", options.stolen_proof.display()))?;
    let (participant, mut node) = options.member.begin().await?;
    let play = async |turn: &Turn<'_>, node: &mut NodeClient| play(turn, node, &proof).await;
    Ok(participant
        .rounds(&mut node, options.member.rounds, play)
        .await?)
}

async fn play(
    turn: &Turn<'_>,
    node: &mut NodeClient,
    proof: &[u8],
) -> Result<Option<Refusal>, ParticipantError> {
    let base = turn.base(node).await?;
    let expected = turn.commit(node, &base.quantised).await?;
    // It claims half the loss.
    let losses = match expected.disclosure {
        Disclosure::Nothing => Losses::Hidden,
        Disclosure::Losses => Losses::Disclosed {
            before: 2 << 24,
            after: 1 << 24,
            elements: 1,
        },
    };
    turn.submit(node, expected.with(losses), proof.to_vec())
        .await
}
