//! `zk0 node join`: take part in the rounds of a network.

use crate::network::Membership;
use crate::otlp::OtlpOptions;
use anyhow::{Context, Result};
use std::path::PathBuf;
use zk0_node::turn::Training;
use zk0_prover::service::ProvingClient;
use zk0_smolvla::policy::device::device;
use zk0_smolvla::train::adaptive::{Adaptation, Boost};
use zk0_smolvla::train::optimizer::check_alpha;

/// `zk0 node join`.
#[derive(Debug, clap::Args)]
pub struct Join {
    #[command(flatten)]
    member: Membership,
    /// The address of the proving service, such as http://127.0.0.1:7072. `zk0 prover serve` runs it. With http:// nothing is encrypted.
    #[arg(long, value_name = "ADDRESS")]
    prover: String,
    /// Believe only a proving service whose certificate is signed by one in this PEM file [default: the authorities that the system trusts]
    #[arg(long, value_name = "FILE")]
    prover_ca: Option<PathBuf>,
    /// Train on this device: cpu, cuda or cuda:N (only builds by `make cuda`). Samples are prepared, committed to and evaluated on the CPU all
    /// the same.
    #[arg(long, default_value = "cpu")]
    device: String,
    /// Train for this many optimiser steps in each round. Where the network's rules ask for SCAFFOLD, they say the steps and the learning
    /// rate, and --fedprox-mu, --fedcm-alpha, --follow-losses and --lr-boost have to be off.
    #[arg(long, default_value_t = 600)]
    steps: usize,
    /// Use this many samples in each step.
    #[arg(long, default_value_t = 32)]
    batch_size: usize,
    /// Train at this learning rate.
    #[arg(long, default_value_t = 2e-3)]
    learning_rate: f64,
    /// Pull the weights towards the round's base weights with this strength (FedProx).
    #[arg(long, default_value_t = 0.0, value_name = "MU")]
    fedprox_mu: f64,
    /// Take this part of each step from the node's own gradients, above 0 and at most 1, and the rest from the last global step (FedCM).
    /// With 1, FedCM is off.
    #[arg(long, default_value_t = 1.0, value_name = "ALPHA")]
    fedcm_alpha: f64,
    /// Adapt the learning rate and the strength of FedProx to the loss of the rounds' base weights on this recording. If the loss stalls
    /// over three rounds, both are multiplied by 0.8. If it grows by 5 %, both are multiplied by 1.1.
    #[arg(long)]
    follow_losses: bool,
    /// Multiply the learning rate by this factor, 1 to 10, in rounds that begin at more than twice the average loss so far.
    #[arg(long, value_name = "FACTOR")]
    lr_boost: Option<f64>,
    #[command(flatten)]
    pub otlp: OtlpOptions,
}

/// Runs the command.
pub async fn run(options: &Join) -> Result<()> {
    let boost = options.lr_boost.map(|factor| Boost {
        factor,
        ..Boost::default()
    });
    if let Some(boost) = boost {
        boost.check().context("--lr-boost")?;
    }
    check_alpha(options.fedcm_alpha).context("--fedcm-alpha")?;
    let training = Training {
        device: device(&options.device).context("--device")?,
        steps: options.steps,
        batch_size: options.batch_size,
        learning_rate: options.learning_rate,
        fedprox_mu: options.fedprox_mu,
        fedcm_alpha: options.fedcm_alpha,
        adaptation: Adaptation {
            follow: options.follow_losses,
            boost,
        },
    };
    let (participant, mut node) = options.member.begin().await?;
    let prover = ProvingClient::address(options.prover.clone());
    let mut prover = ProvingClient::connect(prover.with_ca(options.prover_ca.clone())).await?;
    Ok(participant
        .run(&mut node, &mut prover, &training, options.member.rounds)
        .await?)
}
