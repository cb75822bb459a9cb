//! `zk0 prover`: the proving service that the nodes of one machine share, and what proving costs.

use anyhow::{Context, Result};
use std::net::SocketAddr;
use tokio::{net::TcpListener, runtime::Runtime};
use zk0_prover::{
    cycles, device::DeviceKind, execute::Executor, service::ProvingService, sp1::Sp1Backend,
};

/// What to do.
#[derive(Debug, clap::Subcommand)]
pub enum Command {
    /// Serve proofs to the nodes of this machine, one at a time. Wants 20 GB of free memory.
    Serve {
        /// Address to listen on; port 0 takes a free one. Witnesses hold private samples: keep it on loopback.
        #[arg(long, default_value = "127.0.0.1:7072")]
        listen: SocketAddr,
        /// Claims that may wait.
        #[arg(long, default_value_t = 16)]
        queue: usize,
        /// What to prove on: cpu, or cuda for an NVIDIA GPU (in builds of `make cuda`).
        #[arg(long, default_value_t)]
        device: DeviceKind,
    },
    /// Print what claims cost, one JSON line per profile and mode, from execute mode: no proof is made.
    Cycles,
}

/// Runs the command.
pub fn run(command: &Command) -> Result<()> {
    let runtime = Runtime::new().context("starting the runtime")?;
    match command {
        Command::Serve {
            listen,
            queue,
            device,
        } => runtime.block_on(serve(*listen, *queue, *device)),
        Command::Cycles => runtime.block_on(cycles()),
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
    let listener = TcpListener::bind(listen)
        .await
        .with_context(|| format!("listening on {listen}"))?;
    let address = listener.local_addr()?;
    let backend = Sp1Backend::new(device).await?;
    // Before its first proof the service expects a GPU, too, to take a CPU's time.
    let cores = std::thread::available_parallelism().map_or(1, |cores| cores.get());
    let service = ProvingService::start(backend, queue, cores);
    tracing::info!(listening = %address, "proving service on {address}; SP1 is starting on device {device}");
    service
        .serve(listener, crate::interrupted())
        .await
        .context("the proving service")
}
