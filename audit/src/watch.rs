//! Audits a log again and again. What was seen has to stay: the watch raises an alarm when the log forks, stays behind or breaks a rule.

use crate::fetch::behind::{LogBehind, Shortfall};
use crate::fetch::temporary::Temporary;
use crate::fetch::{fetch, is_fault};
use crate::log_source::{source, Trust, WrongUsage};
use crate::report::history;
use crate::report::verdict::{faults, sentence, Audited};
use crate::run::{check_state_file, Audit, SeenLog};
use crate::trusted_programs::TrustedPrograms;
use crate::Depth;
use anyhow::{bail, Context, Result};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};
use zk0_ledger::folder;
use zk0_ledger::replay::{SaveOptions, SavedReplay, Verdict};
use zk0_protocol::tlog::checkpoint::Checkpoint;
use zk0_protocol::Entry;

/// The result of a look at the log.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Look {
    /// The log continues what was seen, and nothing new is wrong.
    Continues,
    /// The log shows fewer entries than before, and has time to come back. Nothing was checked.
    Behind(LogBehind),
    /// The log cannot be trusted, for one or more reasons.
    Alarm(Vec<String>),
}

/// What a watch reports.
#[derive(Debug)]
pub enum WatchEvent<'a> {
    /// The first look checked the whole log.
    First {
        /// Whether everything was checked.
        verdict: Verdict,
        /// The number of entries.
        entries: u64,
        /// The network's id.
        network: &'a str,
    },
    /// A new entry is verified.
    New {
        /// The index, from 0.
        index: u64,
        /// The entry.
        entry: &'a Entry,
    },
}

/// Which log to watch, and how.
#[derive(Clone, Debug)]
pub struct WatchOptions {
    /// A ledger's folder, an export, or a served log's address.
    pub ledger: String,
    /// Whom to trust.
    pub trust: Trust,
    /// Light or full.
    pub depth: Depth,
    /// What the auditor answers for.
    pub named: TrustedPrograms,
    /// The file of what was seen; `None` to forget it at the end.
    pub state: Option<PathBuf>,
    /// The folder of what is fetched; `None` to remove it at the end.
    pub mirror: Option<PathBuf>,
    /// How long the log may show fewer entries than before. Then it was rolled back.
    pub behind_for: Duration,
}

/// A watch over one log.
pub struct LogWatch {
    options: WatchOptions,
    /// The log's mirror; `None` to read it in place.
    mirror: Option<PathBuf>,
    state: PathBuf,
    /// The newest verified log. The state file may lack it: not written, or removed.
    seen: Option<SeenLog>,
    _made: Temporary,
}

impl LogWatch {
    /// Begins to watch, without a fetch.
    ///
    /// # Errors
    /// The state file is unreadable, there is no folder to watch, or options conflict.
    pub fn begin(options: WatchOptions) -> Result<Self> {
        if let Some(state) = &options.state {
            check_state_file(state)?;
        }
        let made = Temporary::make().context("making a temporary directory")?;
        let lies_here = folder::database(Path::new(&options.ledger)).exists();
        // A folder's own checkpoint is not cosigned. With a witness policy, the folder is read as if published.
        let mirror = match lies_here && options.trust.witness_policy.is_none() {
            true if options.mirror.is_some() => {
                return Err(WrongUsage(format!(
                    "{} is a ledger's directory: --mirror is for an export or a served log",
                    options.ledger
                ))
                .into());
            }
            true => None,
            false => Some(
                options
                    .mirror
                    .clone()
                    .unwrap_or_else(|| made.path().join("mirror")),
            ),
        };
        if !lies_here {
            // A watch waits for a log that does not answer, but not for a mistyped folder.
            source(&options.ledger, options.trust.ca.as_deref())?;
        }
        let state = options
            .state
            .clone()
            .unwrap_or_else(|| made.path().join("state"));
        // Without the state file, a rollback would go unnoticed, so the user must know.
        SavedReplay::read(&state).context(
            "the state file cannot be read: remove it to start again, but then a fork or a rollback since then goes unnoticed",
        )?;
        Ok(Self {
            options,
            mirror,
            state,
            seen: None,
            _made: made,
        })
    }

    /// How many entries this watch has verified; `None` before the first.
    pub fn entries(&self) -> Option<u64> {
        self.seen.map(|seen| seen.checkpoint.size)
    }

    /// Fetches and verifies what is new, and reports it to `seen`. `progress` gets the numbers of verified and of all entries.
    ///
    /// # Errors
    /// The log does not answer, or the file system fails. An unwritten state file is an error, too: the next watch would not notice a
    /// rollback. This watch remembers what it has seen.
    pub fn look(
        &mut self,
        progress: Option<&(dyn Fn(u64, u64) + Sync)>,
        mut seen: impl FnMut(WatchEvent<'_>),
    ) -> Result<Look> {
        let network = self.options.trust.network;
        let saved = SavedReplay::read(&self.state)?;
        let dir = match &self.mirror {
            None => PathBuf::from(&self.options.ledger),
            Some(dir) => {
                if let Err(error) = self.fetch(dir) {
                    return self.look_of(error, saved.as_ref());
                }
                dir.clone()
            }
        };
        let known = saved.as_ref().map(|saved| saved.size);
        let before = known.max(self.seen.map(|seen| seen.checkpoint.size));
        let fetch_again = || self.fetch(&dir);
        let copied = self.mirror.is_some();
        let audit = Audit {
            depth: self.options.depth,
            named: self.options.named.clone(),
            network,
            threads: None,
            state_file: Some(SaveOptions {
                path: self.state.clone(),
                every: Duration::from_secs(30),
            }),
            seen: self.seen,
            behind_for: self.options.behind_for,
            fetch_again: copied.then_some(&fetch_again),
            progress,
        };
        let audited = match audit.run(&dir) {
            // What was seen must stay, so another network is an alarm.
            Err(error) if error.is::<WrongUsage>() => return Ok(alarm(&error)),
            Err(error) => return self.look_of(error, saved.as_ref()),
            Ok(audited) => audited,
        };
        if audited.holds() {
            self.remember(&audited);
        }
        report(&dir, before, &audited, &mut seen)?;
        if !audited.holds() {
            let faults = faults(&audited);
            return Ok(if faults.is_empty() {
                alarm(&sentence(&audited).1)
            } else {
                Look::Alarm(faults)
            });
        }
        match &audited.unsaved {
            None => Ok(Look::Continues),
            Some(why) => bail!(
                "the state of this watch cannot be saved, so that after a restart it would not notice a fork or a rollback: {why}. Free \
                 the disk, or name another file with --state"
            ),
        }
    }

    fn look_of(&self, error: anyhow::Error, saved: Option<&SavedReplay>) -> Result<Look> {
        let saved = saved.map(|saved| (&*self.state, saved));
        let (mirror, behind_for) = (self.mirror.as_deref(), self.options.behind_for);
        match Shortfall::of(&error, mirror, saved, behind_for) {
            Some(Shortfall::Behind(behind)) => Ok(Look::Behind(behind)),
            Some(Shortfall::RolledBack(why)) => Ok(alarm(&why)),
            None if is_fault(&error) => Ok(alarm(&error)),
            None => Err(error),
        }
    }

    fn remember(&mut self, audited: &Audited) {
        if let Some(root) = audited.root.as_deref().and_then(|root| root.parse().ok()) {
            let size = audited.entries;
            self.seen = Some(SeenLog {
                checkpoint: Checkpoint { size, root },
                at: Instant::now(),
            });
        }
    }

    fn fetch(&self, dir: &Path) -> Result<()> {
        let Trust {
            network,
            witness_policy,
            ca,
        } = &self.options.trust;
        let source = source(&self.options.ledger, ca.as_deref())?;
        fetch(
            source.as_ref(),
            dir,
            witness_policy.as_ref(),
            network.as_ref(),
            self.options.depth.into(),
        )?;
        Ok(())
    }
}

fn alarm(why: &impl ToString) -> Look {
    Look::Alarm(vec![why.to_string()])
}

/// Reports what the audit verified and the watch had not seen.
fn report(
    dir: &Path,
    before: Option<u64>,
    audited: &Audited,
    seen: &mut impl FnMut(WatchEvent<'_>),
) -> Result<()> {
    let Some(before) = before else {
        seen(WatchEvent::First {
            verdict: audited.verdict,
            entries: audited.entries,
            network: audited.network.as_deref().unwrap_or("unknown"),
        });
        return Ok(());
    };
    if audited.entries <= before {
        return Ok(());
    }
    let root = audited.root.as_deref().unwrap_or_default();
    history::read(dir, audited.entries, root, |index, entry| {
        if index >= before {
            seen(WatchEvent::New { index, entry });
        }
    })
}
