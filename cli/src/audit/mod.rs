//! `zk0 audit`: checks a ledger without trust. The auditor's light build has this and [`crate::ledger`].

mod failed;
mod named_options;
mod progress_bar;
mod proof;
#[cfg(feature = "full")]
mod recording;
mod replay;
mod show;
mod watch;
#[cfg(feature = "full")]
pub mod watch_metrics;

use crate::output;
use anyhow::Result;
use failed::AuditFailed;
use std::process::ExitCode;
use zk0_audit::fetch::is_fault;
use zk0_audit::log_source::WrongUsage;

/// What to do.
#[derive(Debug, clap::Subcommand)]
pub enum AuditCommand {
    /// Check a ledger from its first entry: signatures, the tree, checkpoints, rules, proofs, refusals, and the averaged weights. The exit
    /// code is 0 if everything was checked and is right (VERIFIED), 1 if anything is wrong (FAILED), 3 if something was not checked
    /// (INCOMPLETE), 2 if an option is wrong, and 4 if there is no verdict, because the ledger cannot be read or is behind what an earlier
    /// audit saw of it.
    Replay(replay::AuditReplayOptions),
    /// Show what happened: the network, its rounds and nodes, or an entry. This checks no proofs; `zk0 audit replay` does.
    Show(show::AuditShowOptions),
    /// Check a log again and again. Each time, new entries are checked, and the log must continue what was seen before. This prints a line
    /// for each new entry. It ends with exit code 1 when the log shows two histories, stays behind what was seen of it, breaks a rule, or
    /// lacks cosignatures.
    Watch(watch::AuditWatchOptions),
    /// Make a file that proves that an entry is in a log (C2SP tlog-proof). `zk0 audit verify-proof` checks it without a network.
    Prove(proof::AuditProveOptions),
    /// Check such a file. The exit code is 0 if the entry is in the log, 1 if the file does not prove it, 2 if an option is wrong, and 4 if
    /// the file cannot be read.
    VerifyProof(proof::Verify),
    /// Compare a registered dataset with the recording that it is of. This needs the recording and the node's secret. It draws the frames,
    /// makes their samples with the network's policy, and compares their leaves with those that the node registered. The exit code is 0
    /// if they are the same, 1 if not, 2 if an option is wrong, and 4 if there is no verdict, because something cannot be read.
    #[cfg(feature = "full")]
    Recording(Box<recording::AuditRecordingOptions>),
}

/// Runs the command. All but `replay` end with 1 if the check fails.
pub fn run(command: &AuditCommand) -> Result<ExitCode> {
    let holds = match command {
        AuditCommand::Replay(options) => return replay::run(options),
        AuditCommand::Show(options) => show::run(options)?,
        AuditCommand::Watch(options) => watch::run(options)?,
        AuditCommand::Prove(options) => proof::prove(options).map(|()| true)?,
        AuditCommand::VerifyProof(options) => proof::verify(options)?,
        #[cfg(feature = "full")]
        AuditCommand::Recording(options) => recording::run(options)?,
    };
    if holds {
        return Ok(ExitCode::SUCCESS);
    }
    // An unwritten verdict stands all the same.
    output::finish().map_err(|error| {
        let why = "the verdict is FAILED, but not all that this audit found could be written";
        error.context(AuditFailed(why.into()))
    })?;
    Ok(ExitCode::FAILURE)
}

impl AuditCommand {
    /// An error's exit code. An unreadable ledger has no verdict.
    pub fn error_code(&self, error: &anyhow::Error) -> ExitCode {
        ExitCode::from(match self {
            _ if error.is::<WrongUsage>() => 2,
            _ if is_fault(error) || error.is::<AuditFailed>() => 1,
            Self::Replay(_) | Self::Watch(_) | Self::VerifyProof(_) => 4,
            #[cfg(feature = "full")]
            Self::Recording(_) => 4,
            Self::Show(_) | Self::Prove(_) => 1,
        })
    }
}
