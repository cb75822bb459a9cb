//! The one binary. Exit codes: 0 all is well; 1 it is not (an audit that fails, a refusal, an error); 2 wrong usage.

use clap::{Parser, Subcommand};
use std::process::ExitCode;
use zk0::{audit, ledger, logging};

#[cfg(feature = "full")]
#[global_allocator]
static ALLOCATOR: zk0_smolvla::policy::memory::Allocator = zk0_smolvla::policy::memory::Allocator;

/// Federated learning in which a contribution counts only if it is proven.
#[derive(Parser)]
#[command(name = "zk0", version, max_term_width = 100)]
struct Cli {
    /// How to write the log (to standard error).
    #[arg(long, global = true, value_enum, default_value_t)]
    log: logging::LogFormat,
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Run a whole federation on this machine: aggregator, prover and nodes, then the audit.
    #[cfg(feature = "full")]
    Demo(zk0::demo::Options),
    /// The demo's lazy node. `zk0 demo` starts it.
    #[cfg(feature = "full")]
    #[command(hide = true)]
    DemoLazyNode(zk0::demo::lazy_node::Options),
    /// Take part in a network with one's own recordings.
    #[cfg(feature = "full")]
    #[command(subcommand)]
    Node(zk0::node::Command),
    /// Found a network and run its rounds.
    #[cfg(feature = "full")]
    #[command(subcommand)]
    Aggregator(zk0::aggregator::Command),
    /// Propose, vote, dispute, change a key.
    #[cfg(feature = "full")]
    #[command(subcommand)]
    Governance(Box<zk0::governance::Command>),
    /// Make proofs for the nodes of this machine.
    #[cfg(feature = "full")]
    #[command(subcommand)]
    Prover(zk0::prover::Command),
    /// Train a policy on recordings.
    #[cfg(feature = "full")]
    Train(Box<zk0::train::Options>),
    /// Measure policies on recordings.
    #[cfg(feature = "full")]
    Eval(zk0::eval::Options),
    /// Look at recordings before training on them.
    #[cfg(feature = "full")]
    #[command(subcommand)]
    Dataset(zk0::dataset::Command),
    /// Compare the fixed-point loss with the float32 one, on untrained and trained weights.
    #[cfg(feature = "full")]
    Fidelity(zk0::fidelity::Options),
    /// Cosign logs, so that none can show two histories.
    #[cfg(feature = "full")]
    #[command(subcommand)]
    Witness(zk0::witness::Command),
    /// Check a ledger, trusting nobody.
    #[command(subcommand)]
    Audit(audit::Command),
    /// Publish, mirror and check a ledger as files, and prove what is in it.
    #[command(subcommand)]
    Ledger(ledger::Command),
}

fn main() -> ExitCode {
    let cli = Cli::parse();
    logging::init(cli.log);
    let done = match cli.command {
        #[cfg(feature = "full")]
        Command::Demo(options) => zk0::demo::run(&options),
        #[cfg(feature = "full")]
        Command::DemoLazyNode(options) => zk0::demo::lazy_node::run(&options),
        #[cfg(feature = "full")]
        Command::Node(command) => zk0::node::run(&command),
        #[cfg(feature = "full")]
        Command::Aggregator(command) => zk0::aggregator::run(&command),
        #[cfg(feature = "full")]
        Command::Governance(command) => zk0::governance::run(&command),
        #[cfg(feature = "full")]
        Command::Prover(command) => zk0::prover::run(&command),
        #[cfg(feature = "full")]
        Command::Train(options) => zk0::train::run(&options),
        #[cfg(feature = "full")]
        Command::Eval(options) => zk0::eval::run(&options),
        #[cfg(feature = "full")]
        Command::Dataset(command) => match zk0::dataset::run(&command) {
            Ok(true) => Ok(()),
            Ok(false) => return ExitCode::FAILURE,
            Err(error) => Err(error),
        },
        #[cfg(feature = "full")]
        Command::Fidelity(options) => zk0::fidelity::run(&options),
        #[cfg(feature = "full")]
        Command::Witness(command) => zk0::witness::run(&command),
        Command::Audit(command) => match audit::run(&command) {
            Ok(true) => Ok(()),
            Ok(false) => return ExitCode::FAILURE,
            Err(error) => Err(error),
        },
        Command::Ledger(command) => match ledger::run(&command) {
            Ok(true) => Ok(()),
            Ok(false) => return ExitCode::FAILURE,
            Err(error) => Err(error),
        },
    };
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            match cli.log {
                // Whoever reads the JSON lines shall read the end as well.
                logging::LogFormat::Json => tracing::error!("{error:#}"),
                logging::LogFormat::Text => eprintln!("error: {error:#}"),
            }
            ExitCode::FAILURE
        }
    }
}
