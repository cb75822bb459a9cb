//! `zk0 audit watch`: an audit that does not end. What was seen once has to stay: a log that forks, goes back or breaks a rule
//! ends it, loudly.

use super::{
    fetch::{fetch, Wanted},
    replay::Audit,
    show, story,
    words::{verdict, Audited},
};
use crate::ledger::{source, Trust};
use anyhow::{bail, Context, Result};
use serde_json::json;
use std::{
    io::Write,
    path::{Path, PathBuf},
    thread::sleep,
    time::Duration,
};
use tempfile::TempDir;
use zk0_aggregator::audit::Depth;
use zk0_ledger::{
    blobs::BlobError,
    error::LedgerError,
    folder,
    mirror::MirrorError,
    policy::Policy,
    published::PublishedError,
    replay::{Keep, Saved},
};

/// `zk0 audit watch`.
#[derive(Debug, clap::Args)]
pub struct Options {
    /// A ledger's directory, an export of one, or the address of a served log.
    ledger: String,
    /// Seconds between two looks.
    #[arg(long, value_name = "SECONDS", default_value_t = 60)]
    interval: u64,
    /// Look so often, then end; without it, for ever.
    #[arg(long, value_name = "TIMES")]
    looks: Option<u64>,
    /// Remember in this file what was seen, so that after a restart a fork or a rollback is still noticed, and only what is new is
    /// read.
    #[arg(long, value_name = "FILE")]
    state: Option<PathBuf>,
    /// Keep what is fetched in this directory; only what is new is fetched after a restart.
    #[arg(long, value_name = "DIR")]
    mirror: Option<PathBuf>,
    /// Read no weights, and fetch none: see `replay`.
    #[arg(long)]
    light: bool,
    /// Print JSON lines.
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    trust: Trust,
}

/// How many looks in a row may fail for want of an answer, or of a file that is about to come.
const PATIENCE: u32 = 5;

/// Runs it; `false` when something is wrong with the log.
pub fn run(options: &Options) -> Result<bool> {
    let mut watch = Watch::begin(options)?;
    let mut failed = 0;
    let mut look = 0;
    loop {
        match watch.look() {
            Ok(Look::Continues) => failed = 0,
            Ok(Look::Alarm(why)) => {
                options.say("ALARM", &why);
                return Ok(false);
            }
            Err(error) => {
                failed += 1;
                tracing::warn!("look {failed} of {PATIENCE} without an answer: {error:#}");
                if failed == PATIENCE {
                    return Err(error.context(format!("{} gives no answer", options.ledger)));
                }
            }
        }
        look += 1;
        if options.looks == Some(look) {
            // What was never seen is not verified.
            if failed > 0 {
                bail!("{} gave no answer at the last look", options.ledger);
            }
            return Ok(true);
        }
        sleep(Duration::from_secs(options.interval));
    }
}

impl Options {
    fn say(&self, label: &str, text: &str) {
        let text = super::describe::printable(text);
        match self.json {
            true => println!("{}", json!({ "event": label.to_lowercase(), "text": text })),
            false => println!("{label:<12} {text}"),
        }
        let _ = std::io::stdout().flush();
    }
}

enum Look {
    Continues,
    /// Why the log is not to be trusted.
    Alarm(String),
}

struct Watch<'a> {
    options: &'a Options,
    policy: Option<Policy>,
    /// Where the log is fetched to; `None` when it is read where it lies.
    mirror: Option<PathBuf>,
    audit: Audit,
    memory: PathBuf,
    _made: TempDir,
}

impl<'a> Watch<'a> {
    fn begin(options: &'a Options) -> Result<Self> {
        let made = tempfile::tempdir().context("making a temporary directory")?;
        let policy = options.trust.policy()?;
        let lies_here = folder::database(Path::new(&options.ledger)).exists();
        // A folder's own checkpoint is not cosigned: with a policy it is read as it would be published.
        let mirror = match lies_here && policy.is_none() {
            true if options.mirror.is_some() => {
                bail!(
                    "{} is a ledger's directory: --mirror is for an export or a served log",
                    options.ledger
                )
            }
            true => None,
            false => Some(
                options
                    .mirror
                    .clone()
                    .unwrap_or_else(|| made.path().join("mirror")),
            ),
        };
        let memory = options
            .state
            .clone()
            .unwrap_or_else(|| made.path().join("state"));
        // A memory that was lost would let a rollback pass: whoever runs this has to know.
        Saved::read(&memory).context(
            "what was seen before cannot be read: remove the file to begin anew, but then a fork or a rollback since is not noticed",
        )?;
        let depth = match options.light {
            true => Depth::Light,
            false => Depth::Full,
        };
        Ok(Self {
            options,
            policy,
            mirror,
            audit: Audit {
                depth,
                network: options.trust.network,
                threads: None,
                memory: Some(Keep {
                    path: memory.clone(),
                    every: Duration::from_secs(30),
                }),
                quiet: options.json,
            },
            memory,
            _made: made,
        })
    }

    /// Fetches, verifies, and tells what is new.
    fn look(&mut self) -> Result<Look> {
        let wanted = match self.audit.depth {
            Depth::Light => Wanted::Proofs,
            Depth::Full => Wanted::Everything,
        };
        let dir = match &self.mirror {
            None => PathBuf::from(&self.options.ledger),
            Some(dir) => {
                let source = source(&self.options.ledger)?;
                let network = self.options.trust.network.as_ref();
                match fetch(source.as_ref(), dir, self.policy.as_ref(), network, wanted) {
                    Ok(()) => {}
                    Err(error) if is_alarming(&error) => return Ok(Look::Alarm(error.to_string())),
                    Err(error) => return Err(error.into()),
                }
                dir.clone()
            }
        };
        let before = Saved::read(&self.memory)?.map(|saved| saved.size);
        let audited = self.audit.run(&dir)?;
        self.tell(&dir, before, &audited)?;
        match audited.holds() {
            true => Ok(Look::Continues),
            false => Ok(Look::Alarm(verdict(&audited))),
        }
    }

    fn tell(&self, dir: &Path, before: Option<u64>, audited: &Audited) -> Result<()> {
        let Some(before) = before else {
            let text = format!(
                "{} entries of network {}",
                audited.entries,
                audited.network.as_deref().unwrap_or("unknown")
            );
            self.options.say("verified", &text);
            return Ok(());
        };
        if audited.entries <= before {
            return Ok(());
        }
        let root = audited.root.as_deref().unwrap_or_default();
        story::read(dir, audited.entries, root, |index, entry| {
            if index >= before {
                match self.options.json {
                    true => println!("{}", show::as_json(index, entry)),
                    false => println!("{}", show::line(index, entry)),
                }
            }
        })?;
        let _ = std::io::stdout().flush();
        Ok(())
    }
}

/// Whether what was served is wrong, and not only missing or late.
fn is_alarming(error: &MirrorError) -> bool {
    match error {
        MirrorError::Published(error) => !matches!(
            error,
            PublishedError::Source(_) | PublishedError::Missing(..) | PublishedError::NoCheckpoint
        ),
        MirrorError::Ledger(error) => matches!(
            error,
            LedgerError::RolledBack { .. }
                | LedgerError::Forked { .. }
                | LedgerError::OtherNetwork { .. }
                | LedgerError::BadEntry { .. }
                | LedgerError::Rule(_)
                | LedgerError::CheckpointFile { .. }
                | LedgerError::Blob(BlobError::WrongDigest { .. } | BlobError::TooLarge { .. })
        ),
        MirrorError::Checkpoint { .. } | MirrorError::Witnesses(_) => true,
    }
}
