//! `zk0 aggregator`: found a network, enrol nodes, run rounds.

mod checkpoints_folder;
mod enrolment;
mod hub_uploads;
mod init;
pub mod log_store;
mod network_edge;
mod policy_folders;
mod public_samples;
mod recordings_like;
mod rotate_log_key;
mod rules;
mod serve;
mod witness_check;

use crate::output::println;
pub use enrolment::NodeToEnrol;
use enrolment::{Enrol, OperatorDecides};
pub use rules::read_rules;

use crate::keys;
use anyhow::Result;
use init::Init;
use public_samples::MakeSamples;
use rotate_log_key::RotateLogKey;
use rules::{CommonRules, LEAST_UPDATE_LIMIT};
use serve::AggregatorServeOptions;
use std::path::PathBuf;
use zk0_service::tls::local_authority::{LocalAuthority, CA, CA_KEY, CERTIFICATE, KEY};
use zk0_service::traces::export::Traces;

/// What to do.
#[derive(Debug, clap::Subcommand)]
pub enum AggregatorCommand {
    /// Make the signing key of a network's log.
    Keygen {
        /// Write the key to this file. An existing file is kept.
        file: PathBuf,
    },
    /// Print rules as JSON. You can edit them, and found a network with them (`zk0 aggregator init --rules`). `max_update_bytes` suits
    /// the micro profile; for another policy, `init` states what it has to be.
    Rules(CommonRules),
    /// Found a network: its rules, its first policy, and its first nodes.
    Init(Box<Init>),
    /// Enrol nodes in a network: through its running aggregator (`--aggregator`), or in the ledger's folder if the aggregator is not running.
    Enrol(Enrol),
    /// Suspend a node, where the rules let the operator enrol nodes: it contributes nothing until it is reinstated. The ledger records it.
    Suspend(OperatorDecides),
    /// End the operator's suspension of a node.
    Reinstate(OperatorDecides),
    /// Give the log another key, after the present one was stolen or lost, or to keep the founding key offline from now on. The ledger records
    /// it, and readers, nodes and witnesses follow. Those who have seen the change refuse the former key.
    RotateLogKey(RotateLogKey),
    /// Make public samples for a network that exists, and keep them among the blobs of its ledger. Each round's result is evaluated on the
    /// public samples that the rules name. This prints the rule that a vote can then put in force (`zk0 governance propose rules`).
    Samples(MakeSamples),
    /// Make a certificate authority for tests and local networks, and a certificate that it signs for a server (`serve --tls-certificate`).
    /// Nodes name the authority with `--ca`. For a server on the internet, take a certificate from a public authority instead.
    Certificate {
        /// Write ca.pem, ca.key, server.pem and server.key into this folder. If it holds an authority already (ca.pem and ca.key), that signs a new
        /// certificate, which takes the place of server.pem and server.key.
        dir: PathBuf,
        /// The host name or IP address by which nodes reach the server. Repeat the option for more.
        #[arg(long = "name", value_name = "HOST", required = true)]
        names: Vec<String>,
    },
    /// Run a network: open rounds, verify contributions, and average those that are accepted.
    Serve(Box<AggregatorServeOptions>),
}

impl AggregatorCommand {
    /// The command's traces.
    pub fn traces(&self) -> Result<Option<Traces>> {
        match self {
            Self::Serve(options) => options.otlp.traces("zk0-aggregator"),
            _ => Ok(None),
        }
    }
}

/// Runs the command.
pub fn run(command: &AggregatorCommand) -> Result<()> {
    match command {
        AggregatorCommand::Keygen { file } => println!("{}", keys::generate(file)?),
        AggregatorCommand::Rules(common) => {
            let rules = common.rules(LEAST_UPDATE_LIMIT)?;
            println!("{}", serde_json::to_string_pretty(&rules)?);
        }
        AggregatorCommand::Init(options) => init::found(options)?,
        AggregatorCommand::Enrol(options) => enrolment::enrol(options)?,
        AggregatorCommand::Suspend(options) => enrolment::decide(options, true)?,
        AggregatorCommand::Reinstate(options) => enrolment::decide(options, false)?,
        AggregatorCommand::RotateLogKey(options) => rotate_log_key::rotate(options)?,
        AggregatorCommand::Samples(options) => public_samples::make(options)?,
        AggregatorCommand::Certificate { dir, names } => {
            let path = |name: &str| dir.join(name).display().to_string();
            if dir.join(CA).exists() {
                LocalAuthority::sign_again(dir, names)?;
                println!(
                    "the authority in {} signed the new certificate in {}",
                    path(CA),
                    path(CERTIFICATE)
                );
            } else {
                LocalAuthority::new(names)?.write(dir)?;
            }
            println!(
                "serve with --tls-certificate {} --tls-key {}",
                path(CERTIFICATE),
                path(KEY)
            );
            println!("connect with --ca {}", path(CA));
            println!(
                "keep {} secret: whoever has it can pretend to be the server",
                path(CA_KEY)
            );
        }
        AggregatorCommand::Serve(options) => serve::serve(options)?,
    }
    Ok(())
}
