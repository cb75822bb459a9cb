//! `zk0 witness`: cosign other people's logs, so that none of them can show two histories (C2SP tlog-witness).

use crate::keys;
use anyhow::{Context, Result};
use std::{net::SocketAddr, path::PathBuf, sync::Arc};
use zk0_aggregator::{publish::witness_server::WitnessServer, round::clock::SystemClock};
use zk0_ledger::witness_store::WitnessStore;
use zk0_protocol::tlog::{
    cosigner::Cosigner,
    verifier_key::{Role, VerifierKey},
};

/// What to do.
#[derive(Debug, clap::Subcommand)]
pub enum Command {
    /// Make a key for a witness, and print its verifier key for others' policies.
    Keygen {
        /// Where the key goes.
        file: PathBuf,
        /// The witness' name, best an address without its scheme: witness.example/w1. Use the key for no other name.
        #[arg(long)]
        name: String,
    },
    /// Cosign the checkpoints of these logs, as long as each continues the last.
    Serve {
        /// Where the last checkpoint of each log is kept. Never restore an old copy of it, or start anew with the same key.
        dir: PathBuf,
        /// The witness' key.
        #[arg(long)]
        key: PathBuf,
        /// The witness' name.
        #[arg(long)]
        name: String,
        /// A log to watch: its verifier key, as `zk0 ledger vkey` prints it.
        #[arg(long = "log-key", required = true)]
        logs: Vec<String>,
        /// Address to listen on; port 0 takes a free one. Traffic is not encrypted: put a TLS proxy before it.
        #[arg(long, default_value = "127.0.0.1:7074")]
        listen: SocketAddr,
    },
}

/// Runs the command.
pub fn run(command: &Command) -> Result<()> {
    match command {
        Command::Keygen { file, name } => {
            // The name first: a key for a name that cannot be is of no use.
            VerifierKey::new(Role::Witness, name, &BASE_POINT).context("naming the witness")?;
            keys::generate(file)?;
            println!("{}", Cosigner::new(name, keys::read(file)?)?.key());
            Ok(())
        }
        Command::Serve {
            dir,
            key,
            name,
            logs,
            listen,
        } => {
            let cosigner = Cosigner::new(name, keys::read(key)?)?;
            let logs = logs
                .iter()
                .map(|log| Ok(VerifierKey::of_role(Role::Log, log)?))
                .collect::<Result<_>>()?;
            let witness = WitnessStore::open(dir, cosigner, logs)?;
            tracing::info!("witness {}", witness.key());
            let server = WitnessServer::new(witness, Arc::new(SystemClock));
            crate::serve_http("witness", *listen, server.router(), WitnessServer::limits())
        }
    }
}

/// Some public key: ed25519's base point.
const BASE_POINT: [u8; 32] = {
    let mut bytes = [0x66; 32];
    bytes[0] = 0x58;
    bytes
};
