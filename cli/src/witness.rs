//! `zk0 witness`: cosigns others' logs, so that none can show two histories (C2SP tlog-witness).

use crate::certificate::CertificateOptions;
use crate::keys;
use crate::metrics::MetricsOptions;
use crate::otlp::OtlpOptions;
use crate::output::println;
use crate::serve::serve_http;
use anyhow::Result;
use std::net::SocketAddr;
use std::path::PathBuf;
use std::sync::Arc;
use zk0_aggregator::clock::SystemClock;
use zk0_aggregator::publish::witness_server::WitnessServer;
use zk0_ledger::witness_store::WitnessStore;
use zk0_protocol::tlog::cosigner::Cosigner;
use zk0_protocol::tlog::verifier_key::{KeyError, Role, VerifierKey};
use zk0_service::traces::export::Traces;

/// What to do.
#[derive(Debug, clap::Subcommand)]
pub enum WitnessCommand {
    /// Make the key of a witness and print its verifier key. Others put the verifier key into their witness policies.
    Keygen {
        /// Write the key to this file. An existing file is kept.
        file: PathBuf,
        /// The name of the witness. An address without its scheme is best, such as witness.example/w1. Use the key for no other name.
        #[arg(long, value_parser = witness_name)]
        name: String,
    },
    /// Cosign the checkpoints of logs. A checkpoint is cosigned only if it continues the one before it.
    Serve {
        /// Keep the last checkpoint of each log in this folder. Never replace the folder by an old copy, and never use the key with
        /// another folder: the witness could then cosign two histories.
        dir: PathBuf,
        /// The file of the witness's key.
        #[arg(long)]
        key: PathBuf,
        /// The name of the witness, as it was given to `zk0 witness keygen`.
        #[arg(long, value_parser = witness_name)]
        name: String,
        /// Cosign the log with this verifier key, as `zk0 ledger vkey` prints it. Repeat the option for more logs.
        #[arg(long = "log-key", value_name = "KEY", required = true, value_parser = log_key)]
        logs: Vec<VerifierKey>,
        /// Listen on this address; port 0 takes a free port. Traffic is encrypted only with --tls-certificate.
        #[arg(long, default_value = "127.0.0.1:7074")]
        listen: SocketAddr,
        #[command(flatten)]
        certificate: CertificateOptions,
        #[command(flatten)]
        metrics: Box<MetricsOptions>,
        #[command(flatten)]
        otlp: OtlpOptions,
    },
}

impl WitnessCommand {
    /// The command's traces.
    pub fn traces(&self) -> Result<Option<Traces>> {
        match self {
            Self::Serve { otlp, .. } => otlp.traces("zk0-witness"),
            Self::Keygen { .. } => Ok(None),
        }
    }
}

/// Runs the command.
pub fn run(command: &WitnessCommand) -> Result<()> {
    match command {
        WitnessCommand::Keygen { file, name } => {
            keys::generate(file)?;
            println!("{}", Cosigner::new(name, keys::read(file)?)?.key());
            Ok(())
        }
        WitnessCommand::Serve {
            dir,
            key,
            name,
            logs,
            listen,
            certificate,
            metrics,
            otlp: _,
        } => {
            let cosigner = Cosigner::new(name, keys::read(key)?)?;
            let witness = WitnessStore::open(dir, cosigner, logs.clone())?;
            tracing::info!("the verifier key of this witness is {}", witness.key());
            let server = WitnessServer::new(witness, Arc::new(SystemClock));
            let limits = WitnessServer::limits();
            let observed = server.metrics().observed().clone();
            let beside = || metrics.serve(observed);
            let router = server.router();
            serve_http("witness", *listen, certificate, router, limits, beside)
        }
    }
}

fn witness_name(text: &str) -> Result<String, KeyError> {
    VerifierKey::new(Role::Witness, text, &BASE_POINT)?;
    Ok(text.to_owned())
}

fn log_key(text: &str) -> Result<VerifierKey, KeyError> {
    VerifierKey::of_role(Role::Log, text)
}

/// A public key for checks of names: ed25519's base point.
const BASE_POINT: [u8; 32] = {
    let mut bytes = [0x66; 32];
    bytes[0] = 0x58;
    bytes
};
