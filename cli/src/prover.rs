//! `zk0 prover`: a machine's proving service, and the cost of proofs.

use crate::certificate::{keep_current, CertificateOptions};
use crate::metrics::MetricsOptions;
use crate::otlp::OtlpOptions;
use crate::output::println;
use crate::serve::{interrupted, listening, online, online_until};
use anyhow::{Context, Result};
use std::net::SocketAddr;
use std::time::Duration;
use zk0_aggregator::connections::limits::ConnectionLimits;
use zk0_aggregator::connections::open_files;
use zk0_prover::machine::DeviceKind;
use zk0_prover::measure::cycles;
use zk0_prover::network::{NetworkOptions, ProverSelection};
use zk0_prover::program::Executor;
use zk0_prover::service::{ProvingService, Sp1Backend};
use zk0_service::traces::export::Traces;

/// Time for SP1, which cannot be interrupted. A proof takes minutes.
const ENDING: Duration = Duration::from_secs(1);

/// Connections at once, unless the queue is longer. They leave SP1 enough files to open.
const CONNECTIONS: usize = 256;
/// Besides the waiting claims': the claim being proven, and clients that ask for room.
const BEYOND_QUEUE: usize = 64;

/// What to do.
#[derive(Debug, clap::Subcommand)]
pub enum ProverCommand {
    /// Make proofs for the nodes of this machine, one at a time. On a CPU this needs 20 GiB of free memory.
    Serve {
        /// Listen on this address; port 0 takes a free port. Requests carry a private input, which holds samples of a recording (mode direct)
        /// or their losses (mode succinct), and traffic
        /// is encrypted only with --tls-certificate. Whoever reaches the address can have proofs made, so listen only on this machine or on
        /// a private network.
        #[arg(long, default_value = "127.0.0.1:7072")]
        listen: SocketAddr,
        #[command(flatten)]
        certificate: CertificateOptions,
        /// Let this many claims wait while one is proven.
        #[arg(long, default_value_t = 16, value_parser = clap::value_parser!(u64).range(1..=65_536))]
        queue: u64,
        /// Prove on this device: cpu, cuda for an NVIDIA GPU (only builds by `make cuda`), or network for Succinct's prover network or an
        /// SP1 cluster (only builds by `make network`, and only claims of mode succinct). The network wants the private key of an account
        /// in NETWORK_PRIVATE_KEY, and costs money. NETWORK_RPC_URL is its address, if it is not Succinct's.
        #[arg(long, default_value_t)]
        device: DeviceKind,
        #[command(flatten)]
        network: NetworkArguments,
        #[command(flatten)]
        metrics: MetricsOptions,
        #[command(flatten)]
        otlp: OtlpOptions,
    },
    /// Print what claims cost, one JSON line for each profile and mode. The programs are executed, and no proof is made.
    Cycles,
}

/// How the network is asked. It is read with `--device network` alone.
#[derive(Clone, Copy, Debug, clap::Args)]
pub struct NetworkArguments {
    /// Find a prover on the network by: auction, reserved (an agreement with a prover of Succinct's network) or hosted (Succinct's own
    /// provers, or a cluster of your own).
    #[arg(long, default_value_t)]
    network_strategy: ProverSelection,
    /// Give up a proof on the network after this many minutes.
    #[arg(long, value_name = "MINUTES", default_value_t = 60, value_parser = clap::value_parser!(u64).range(1..=1440))]
    network_minutes: u64,
}

impl ProverCommand {
    /// The command's traces.
    pub fn traces(&self) -> Result<Option<Traces>> {
        match self {
            Self::Serve { otlp, .. } => otlp.traces("zk0-prover"),
            Self::Cycles => Ok(None),
        }
    }
}

/// Runs the command.
pub fn run(command: &ProverCommand) -> Result<()> {
    match command {
        ProverCommand::Serve {
            listen,
            certificate,
            queue,
            device,
            network,
            metrics,
            otlp: _,
        } => {
            let queue = *queue as usize;
            let serving = serve(*listen, certificate, queue, *device, network, metrics);
            online_until(ENDING, serving)
        }
        ProverCommand::Cycles => online(cycles()),
    }
}

async fn cycles() -> Result<()> {
    let executor = Executor::new().await?;
    for case in cycles::cases() {
        let cost = cycles::measure(&executor, case).await?;
        println!("{}", serde_json::to_string(&cost)?);
    }
    Ok(())
}

async fn serve(
    listen: SocketAddr,
    certificate: &CertificateOptions,
    queue: usize,
    device: DeviceKind,
    network: &NetworkArguments,
    metrics: &MetricsOptions,
) -> Result<()> {
    let certificate = certificate.load()?;
    let (listener, address) = listening(listen)?;
    keep_current(certificate.as_ref(), "proving service", address);
    let network = NetworkOptions {
        strategy: network.network_strategy,
        timeout: Duration::from_secs(60 * network.network_minutes),
    };
    let backend = Sp1Backend::new(device, network).await?;
    let pace = backend.pace();
    let mut limits = ConnectionLimits {
        most: connections(queue),
        ..ConnectionLimits::default()
    };
    open_files::fit(&mut limits, 0);
    let service = ProvingService::start(backend, queue, pace).with_connections(limits.most);
    metrics.serve(service.metrics().observed().clone())?;
    tracing::info!(listening = %address, "the proving service listens on {address}, and SP1 is starting on the device {device}");
    let stop = interrupted();
    let served = match &certificate {
        Some(certificate) => service.serve_encrypted(listener, certificate, stop).await,
        None => service.serve(listener, stop).await,
    };
    served.context("the proving service")
}

fn connections(queue: usize) -> usize {
    CONNECTIONS.max(queue.saturating_add(BEYOND_QUEUE))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn there_is_a_connection_for_each_claim_that_waits() {
        assert_eq!(connections(16), CONNECTIONS);
        assert!(connections(1000) > 1001);
    }
}
