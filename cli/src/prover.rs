//! `zk0 prover`: the proving service that the nodes of one machine share, and what proving costs.

use crate::serve::{interrupted, listening, online};
use anyhow::{Context, Result};
use std::net::SocketAddr;
use zk0_prover::machine::DeviceKind;
use zk0_prover::measure::cycles;
use zk0_prover::program::Executor;
use zk0_prover::service::{ProvingService, Sp1Backend};

/// What to do.
#[derive(Debug, clap::Subcommand)]
pub enum Command {
    /// Make proofs for the nodes of this machine, one at a time. This needs 20 GiB of free memory.
    Serve {
        /// Listen on this address; port 0 takes a free port. Requests carry a private input, which holds samples of a recording, and the
        /// traffic is not encrypted. So listen only on this machine.
        #[arg(long, default_value = "127.0.0.1:7072")]
        listen: SocketAddr,
        /// Let this many claims wait.
        #[arg(long, default_value_t = 16)]
        queue: usize,
        /// Prove on this device: cpu, or cuda for an NVIDIA GPU. Only builds by `make cuda` know cuda.
        #[arg(long, default_value_t)]
        device: DeviceKind,
    },
    /// Print what claims cost, one JSON line for each profile and mode. The programs are executed, and no proof is made.
    Cycles,
}

/// Runs the command.
pub fn run(command: &Command) -> Result<()> {
    match command {
        Command::Serve {
            listen,
            queue,
            device,
        } => online(serve(*listen, *queue, *device)),
        Command::Cycles => online(cycles()),
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

async fn serve(listen: SocketAddr, queue: usize, device: DeviceKind) -> Result<()> {
    let (listener, address) = listening(listen).await?;
    let backend = Sp1Backend::new(device).await?;
    // Until the first proof is made, the service expects that a GPU takes as long as a CPU.
    let cores = std::thread::available_parallelism().map_or(1, |cores| cores.get());
    let service = ProvingService::start(backend, queue, cores);
    tracing::info!(listening = %address, "the proving service listens on {address}, and SP1 is starting on the device {device}");
    service
        .serve(listener, interrupted())
        .await
        .context("the proving service")
}
