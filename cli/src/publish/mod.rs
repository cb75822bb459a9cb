//! `zk0 publish`: publishes what a network has trained.

mod hub;
pub mod model_card;
pub mod round_facts;

pub use hub::{facts, summary, target, Hub};

use anyhow::Result;

/// Where to publish.
#[derive(Debug, clap::Subcommand)]
pub enum PublishCommand {
    /// Publish the global weights of a round on the Hugging Face Hub: a policy folder, which LeRobot loads, with a model card that states who contributed
    /// and how anybody verifies it. HF_TOKEN holds a token that may write, or `hf auth login` has left one. HF_ENDPOINT names another Hub.
    Hub(Hub),
}

/// Runs the command.
pub fn run(command: &PublishCommand) -> Result<()> {
    match command {
        PublishCommand::Hub(options) => options.run(),
    }
}
