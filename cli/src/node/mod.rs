//! `zk0 node`: take part in a network.

mod estimate;
mod join;

use crate::keys;
use crate::network::Signer;
use crate::output::println;
use crate::serve::online;
use anyhow::Result;
use estimate::EstimateOptions;
use join::Join;
use std::path::PathBuf;
use zk0_service::traces::export::Traces;

/// What to do.
#[derive(Debug, clap::Subcommand)]
pub enum NodeCommand {
    /// Make a node's key and print its identity. The network's operator enrols the identity.
    Keygen {
        /// Write the key to this file. An existing file is kept.
        file: PathBuf,
    },
    /// Print the identity of a key: that of a node, a governor or a log.
    Identity {
        /// The file of the key.
        file: PathBuf,
    },
    /// State what a claim will cost on this machine, before you spend anything: guest cycles, memory, time.
    Estimate(EstimateOptions),
    /// Leave a network. The node is not invited any more, and no round waits for it. What it has contributed stays. To come back, it has to be
    /// enrolled again.
    Leave(Signer),
    /// Join a network: commit to a recording, and then train, prove and submit in each round.
    Join(Box<Join>),
}

impl NodeCommand {
    /// The command's traces.
    pub fn traces(&self) -> Result<Option<Traces>> {
        match self {
            Self::Join(options) => options.otlp.traces("zk0-node"),
            _ => Ok(None),
        }
    }
}

/// Runs the command.
pub fn run(command: &NodeCommand) -> Result<()> {
    match command {
        NodeCommand::Keygen { file } => {
            println!("{}", keys::generate(file)?);
            Ok(())
        }
        NodeCommand::Identity { file } => {
            println!("{}", keys::identity(&keys::read(file)?));
            Ok(())
        }
        NodeCommand::Estimate(options) => online(estimate::run(options)),
        NodeCommand::Leave(signer) => online(async {
            let entry = signer.connect().await?.leave().await?;
            println!("entry {entry}: the node has left");
            Ok(())
        }),
        NodeCommand::Join(options) => online(join::run(options)),
    }
}
