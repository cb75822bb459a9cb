//! `zk0 node`: take part in a network.

mod estimate;
mod join;

use crate::keys;
use anyhow::{Context, Result};
use estimate::Estimate;
use join::Join;
use std::path::PathBuf;
use tokio::runtime::Runtime;

/// What to do.
#[derive(Debug, clap::Subcommand)]
#[allow(clippy::large_enum_variant)] // There is one, for as long as the program runs.
pub enum Command {
    /// Make a node's key and print its identity. The network's operator enrols the identity.
    Keygen {
        /// Write the key to this file. An existing file is kept.
        file: PathBuf,
    },
    /// Say what a claim will cost on this machine, before you spend anything: guest cycles, memory, time.
    Estimate(Estimate),
    /// Join a network: commit to a recording, and then train, prove and submit in each round.
    Join(Join),
}

/// Runs the command.
pub fn run(command: &Command) -> Result<()> {
    let runtime = || Runtime::new().context("starting the runtime");
    match command {
        Command::Keygen { file } => {
            println!("{}", keys::generate(file)?);
            Ok(())
        }
        Command::Estimate(options) => runtime()?.block_on(estimate::run(options)),
        Command::Join(options) => runtime()?.block_on(join::run(options)),
    }
}
