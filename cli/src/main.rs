//! The one binary. Its exit codes:
//!
//! - 0: success
//! - 1: a failure (a failed audit, a refusal, an error)
//! - 2: a wrong command line, or a ledger not to be served, because the log has signed another history, or its blob store does
//!   not continue it (`zk0 aggregator serve`)
//! - 3: an incomplete audit (`zk0 audit replay`), or trouble (`zk0 status`)
//! - 4: an error, so no verdict (`zk0 audit replay`, `watch`, `recording`, `verify-proof`)
//! - 5: a missing file of a contribution that the open round has accepted (`zk0 ledger fsck`, `import`, `restore`)

#[cfg(all(target_os = "linux", target_arch = "x86_64", target_feature = "avx2"))]
mod processor;

use clap::{Parser, Subcommand};
use std::process::ExitCode;
#[cfg(feature = "full")]
use zk0::aggregator::log_store::OtherHistory;
#[cfg(feature = "full")]
use zk0::serve::online;
use zk0::{audit, ledger, logging, output, settings};
#[cfg(feature = "full")]
use zk0_service::traces::export::Traces;

#[cfg(feature = "full")]
#[global_allocator]
static ALLOCATOR: zk0_smolvla::policy::memory::Allocator = zk0_smolvla::policy::memory::Allocator;

/// Federated learning of robot policies, in which a contribution counts only if a proof shows that it is an improvement.
#[derive(Parser)]
#[command(name = "zk0", version, max_term_width = 100)]
struct Cli {
    /// The format of the log, which goes to standard error.
    #[arg(
        long,
        global = true,
        value_enum,
        default_value_t,
        env = "ZK0_LOG",
        hide_env_values = true
    )]
    log: logging::LogFormat,
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    #[cfg(feature = "full")]
    #[command(flatten)]
    Full(Box<Full>),
    /// Check a ledger without trusting anybody.
    #[command(subcommand)]
    Audit(audit::AuditCommand),
    /// Publish, mirror, back up and check a ledger as files.
    #[command(subcommand)]
    Ledger(ledger::LedgerCommand),
}

/// What an auditor's light build cannot do.
#[cfg(feature = "full")]
#[derive(Subcommand)]
enum Full {
    /// Run a whole network on this machine: an aggregator, a prover, nodes, and an audit at the end.
    Demo(zk0::demo::DemoOptions),
    /// The demo's node that cheats. `zk0 demo` starts it.
    #[command(hide = true)]
    DemoLazyNode(zk0::demo::lazy_node::LazyNodeOptions),
    /// Take part in a network with your own recordings.
    #[command(subcommand)]
    Node(zk0::node::NodeCommand),
    /// Found a network and run its rounds.
    #[command(subcommand)]
    Aggregator(zk0::aggregator::AggregatorCommand),
    /// Propose changes, vote on them, dispute contributions, or change a node's key.
    #[command(subcommand)]
    Governance(Box<zk0::governance::GovernanceCommand>),
    /// Show how an aggregator is doing: its rounds, nodes, queue and disk.
    Status(zk0::status::StatusOptions),
    /// Publish what a network has trained.
    #[command(subcommand)]
    Publish(zk0::publish::PublishCommand),
    /// Make proofs for the nodes of this machine.
    #[command(subcommand)]
    Prover(zk0::prover::ProverCommand),
    /// Train a policy on recordings.
    Train(Box<zk0::train::TrainRunOptions>),
    /// Simulate a federation on this machine without proofs, to choose rounds, rates and strategies.
    Simulate(Box<zk0::simulate::SimulateOptions>),
    /// Compare federated training with centralised training and with each node alone, without proofs.
    Compare(Box<zk0::compare::CompareOptions>),
    /// Measure policies on recordings.
    Eval(zk0::eval::EvalOptions),
    /// Look at recordings, and check them, before you train on them.
    #[command(subcommand)]
    Dataset(zk0::dataset::DatasetCommand),
    /// Compare the loss in fixed-point numbers, which proofs use, with the loss in floating-point numbers.
    Fidelity(zk0::fidelity::FidelityOptions),
    /// Take the policy of a round out of a ledger, for LeRobot, with a receipt that names the entry of the log.
    #[command(subcommand)]
    Export(zk0::export::ExportCommand),
    /// Cosign the logs of others, so that none of them can show two histories.
    #[command(subcommand)]
    Witness(zk0::witness::WitnessCommand),
}

fn main() -> ExitCode {
    let cli: Cli = settings::parse();
    match traced(&cli).and_then(|code| output::finish().map(|()| code)) {
        Ok(code) => code,
        Err(error) => {
            let reported = logging::with_causes(&error);
            match cli.log {
                // JSON readers need the reason, too.
                logging::LogFormat::Json => tracing::error!("{reported}"),
                logging::LogFormat::Text => output::tell(format_args!("error: {reported}\n")),
            }
            match &cli.command {
                Command::Audit(command) => command.error_code(&error),
                #[cfg(feature = "full")]
                Command::Full(_) if error.is::<OtherHistory>() => ExitCode::from(2),
                _ => ExitCode::FAILURE,
            }
        }
    }
}

/// Traces are sent until the command ends.
#[cfg(feature = "full")]
fn traced(cli: &Cli) -> anyhow::Result<ExitCode> {
    let traces = match &cli.command {
        Command::Full(command) => command.traces(),
        _ => Ok(None),
    };
    let layer = traces.as_ref().ok().and_then(Option::as_ref);
    logging::init(cli.log, layer.map(Traces::layer));
    let traces = traces?;
    if let Some(traces) = &traces {
        traces.announce();
    }
    run(&cli.command)
}

#[cfg(not(feature = "full"))]
fn traced(cli: &Cli) -> anyhow::Result<ExitCode> {
    logging::init(cli.log, None::<tracing_subscriber::layer::Identity>);
    run(&cli.command)
}

fn run(command: &Command) -> anyhow::Result<ExitCode> {
    match command {
        #[cfg(feature = "full")]
        Command::Full(command) => command.run(),
        Command::Audit(command) => audit::run(command),
        Command::Ledger(command) => ledger::run(command),
    }
}

#[cfg(feature = "full")]
fn code(holds: bool) -> ExitCode {
    if holds {
        ExitCode::SUCCESS
    } else {
        ExitCode::FAILURE
    }
}

#[cfg(feature = "full")]
impl Full {
    fn traces(&self) -> anyhow::Result<Option<Traces>> {
        match self {
            Self::Aggregator(command) => command.traces(),
            Self::Node(command) => command.traces(),
            Self::Prover(command) => command.traces(),
            Self::Witness(command) => command.traces(),
            _ => Ok(None),
        }
    }

    fn run(&self) -> anyhow::Result<ExitCode> {
        match self {
            Self::Demo(options) => online(zk0::demo::run(options))?,
            Self::DemoLazyNode(options) => online(zk0::demo::lazy_node::run(options))?,
            Self::Node(command) => zk0::node::run(command)?,
            Self::Aggregator(command) => zk0::aggregator::run(command)?,
            Self::Governance(command) => zk0::governance::run(command)?,
            Self::Status(options) => return online(zk0::status::run(options)),
            Self::Publish(command) => zk0::publish::run(command)?,
            Self::Prover(command) => zk0::prover::run(command)?,
            Self::Train(options) => zk0::train::run(options)?,
            Self::Simulate(options) => zk0::simulate::run(options)?,
            Self::Compare(options) => zk0::compare::run(options)?,
            Self::Eval(options) => zk0::eval::run(options)?,
            Self::Dataset(command) => return zk0::dataset::run(command).map(code),
            Self::Fidelity(options) => zk0::fidelity::run(options)?,
            Self::Export(command) => return zk0::export::run(command).map(code),
            Self::Witness(command) => zk0::witness::run(command)?,
        }
        Ok(ExitCode::SUCCESS)
    }
}
