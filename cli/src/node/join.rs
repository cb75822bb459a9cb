//! `zk0 node join`: takes part in a network's rounds.

use crate::metrics::MetricsOptions;
use crate::network::Membership;
use crate::otlp::OtlpOptions;
use crate::policy::TransformOptions;
use anyhow::{ensure, Context, Result};
use std::path::PathBuf;
use std::sync::Arc;
use zk0_node::participant::Participant;
use zk0_node::tensorboard::EventFile;
use zk0_node::turn::LocalTraining;
use zk0_prover::service::ProvingClient;
use zk0_smolvla::error::PolicyError;
use zk0_smolvla::policy::device::{check_name, device};
use zk0_smolvla::train::adaptive::{Adaptation, Boost};
use zk0_smolvla::train::optimizer::check_alpha;

/// `zk0 node join`.
#[derive(Debug, clap::Args)]
pub struct Join {
    #[command(flatten)]
    member: Membership,
    /// The address of the proving service, such as http://127.0.0.1:7072. `zk0 prover serve` runs it. In a network of
    /// mode direct it gets the samples of each claim, in mode succinct their losses. With http:// nothing is encrypted.
    #[arg(long, value_name = "ADDRESS")]
    prover: String,
    /// Believe only a proving service whose certificate is signed by one in this PEM file [default: the authorities that the system trusts]
    #[arg(long, value_name = "FILE")]
    prover_ca: Option<PathBuf>,
    /// Train on this device: cpu, cuda or cuda:N (only builds by `make cuda`). Samples are prepared, committed to and evaluated on the CPU all
    /// the same.
    #[arg(long, default_value = "cpu", value_parser = device_name)]
    device: String,
    /// Train for this many optimiser steps in each round. Where the network's rules ask for SCAFFOLD, they state the steps and the learning
    /// rate, and --fedprox-mu, --fedcm-alpha, --follow-losses and --lr-boost have to be off.
    #[arg(long, default_value_t = 600, value_parser = clap::value_parser!(u64).range(1..=1_000_000_000))]
    steps: u64,
    /// Use this many samples in each step.
    #[arg(long, default_value_t = 32, value_parser = clap::value_parser!(u64).range(1..=65_536))]
    batch_size: u64,
    /// Train at this learning rate.
    #[arg(long, default_value_t = 2e-3, value_parser = rate)]
    learning_rate: f64,
    /// Pull the weights towards the round's base weights with this strength (FedProx).
    #[arg(long, default_value_t = 0.0, value_name = "MU", value_parser = mu)]
    fedprox_mu: f64,
    /// Take this part of each step from the node's own gradients, above 0 and at most 1, and the rest from the last global step (FedCM).
    /// With 1, FedCM is off.
    #[arg(long, default_value_t = 1.0, value_name = "ALPHA", value_parser = alpha)]
    fedcm_alpha: f64,
    /// Adapt the learning rate and the strength of FedProx to the loss of the rounds' base weights on this recording. If the loss stalls
    /// over three rounds, both are multiplied by 0.8. If it grows by 5 %, both are multiplied by 1.1.
    #[arg(long)]
    follow_losses: bool,
    /// Multiply the learning rate by this factor, 1 to 10, in rounds that begin at more than twice the average loss so far.
    #[arg(long, value_name = "FACTOR", value_parser = boost)]
    lr_boost: Option<Boost>,
    /// Write the curves of training and of claims into this folder, as TensorBoard event files. Their steps are the optimiser steps that the
    /// node has made in all rounds, by the training histories in its state folder.
    #[arg(long, value_name = "FOLDER")]
    tensorboard: Option<PathBuf>,
    #[command(flatten)]
    transforms: TransformOptions,
    #[command(flatten)]
    metrics: MetricsOptions,
    #[command(flatten)]
    pub otlp: OtlpOptions,
}

/// Runs the command.
pub async fn run(options: &Join) -> Result<()> {
    let curves = options.tensorboard.as_deref().map(EventFile::go_on);
    let curves = curves.transpose().context("--tensorboard")?;
    let training = LocalTraining {
        device: device(&options.device).context("--device")?,
        steps: options.steps as usize,
        batch_size: options.batch_size as usize,
        learning_rate: options.learning_rate,
        fedprox_mu: options.fedprox_mu,
        fedcm_alpha: options.fedcm_alpha,
        adaptation: Adaptation {
            follow: options.follow_losses,
            boost: options.lr_boost,
        },
        curves: curves.map(Arc::new),
    };
    // The seed is fixed, so the cache holds all variants from the start.
    let variants = options.transforms.variants(0)?;
    let (participant, mut node) = options.member.begin().await?;
    options.metrics.serve(node.metrics().observed().clone())?;
    let participant = Participant {
        variants,
        ..participant
    };
    if options.member.rounds == 0 {
        // Without proofs, no proving service is needed.
        return Ok(participant
            .rounds(&mut node, 0, async |_, _| Ok(None))
            .await?);
    }
    let prover = ProvingClient::address(options.prover.clone());
    let mut prover = ProvingClient::connect(prover.with_ca(options.prover_ca.clone())).await?;
    Ok(participant
        .run(&mut node, &mut prover, &training, options.member.rounds)
        .await?)
}

/// Whether this machine can use the device is checked when the node begins.
fn device_name(text: &str) -> Result<String, PolicyError> {
    check_name(text)?;
    Ok(text.to_owned())
}

fn rate(text: &str) -> Result<f64> {
    let rate: f64 = text.parse()?;
    ensure!(
        rate > 0.0 && rate.is_finite(),
        "it has to be a number above 0"
    );
    Ok(rate)
}

fn mu(text: &str) -> Result<f64> {
    let mu: f64 = text.parse()?;
    ensure!(
        mu >= 0.0 && mu.is_finite(),
        "it has to be a number, 0 or above"
    );
    Ok(mu)
}

fn alpha(text: &str) -> Result<f64> {
    let alpha: f64 = text.parse()?;
    check_alpha(alpha)?;
    Ok(alpha)
}

fn boost(text: &str) -> Result<Boost> {
    let boost = Boost {
        factor: text.parse()?,
        ..Boost::default()
    };
    boost.check()?;
    Ok(boost)
}
