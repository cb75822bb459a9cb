//! A log that shows fewer entries than before. That proves nothing: somebody may serve an old copy, as a cache does. So what was seen
//! stays, and the log has some time to come back. If it does not, it was rolled back.

use std::fmt;
use std::fs;
use std::path::Path;
use std::time::Duration;
use zk0_ledger::folder;
use zk0_ledger::published::mirror::MirrorError;
use zk0_ledger::published::reader::PublishedError;
use zk0_ledger::replay::SavedReplay;

/// The log shows fewer entries than before, and has time to come back.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LogBehind {
    /// How many entries it shows.
    pub shown: u64,
    /// How many it showed before.
    pub known: u64,
}

impl fmt::Display for LogBehind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { shown, known } = self;
        write!(
            f,
            "the log is behind: it shows {shown} entries, and {known} were seen before. An old copy, as from a cache, proves nothing, so what was \
             seen stays. If the log does not come back in the time of --behind-for, it was rolled back"
        )
    }
}

impl std::error::Error for LogBehind {}

/// What it means that a log shows fewer entries than before.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Shortfall {
    /// The log has time to come back.
    Behind(LogBehind),
    /// The time is over. The text states that for people.
    RolledBack(String),
}

impl Shortfall {
    /// What `error` means if the log is behind its mirror in the folder `mirror`, or the state file `saved`. The log has the time
    /// `behind_for` to come back, from when that was written. `None` if the error is another one.
    pub fn of(
        error: &anyhow::Error,
        mirror: Option<&Path>,
        saved: Option<(&Path, &SavedReplay)>,
        behind_for: Duration,
    ) -> Option<Self> {
        error.chain().find_map(|cause| {
            if let Some(behind) = cause.downcast_ref::<LogBehind>() {
                return Some(Self::Behind(*behind));
            }
            let (behind, recent) = match cause.downcast_ref::<MirrorError>()? {
                MirrorError::Published(PublishedError::Behind { published, known }) => {
                    let (shown, known) = (*published, *known);
                    let recent = is_recent(&folder::checkpoint(mirror?), behind_for);
                    (LogBehind { shown, known }, recent)
                }
                // A log in an update is read in part only.
                MirrorError::BeingUpdated { network, size, .. } => {
                    let (file, saved) = saved.filter(|(_, saved)| saved.network() == network)?;
                    let (shown, known) = (*size, saved.size);
                    let behind = (shown < known).then_some(LogBehind { shown, known })?;
                    (behind, is_recent(file, behind_for))
                }
                _ => return None,
            };
            Some(if recent {
                Self::Behind(behind)
            } else {
                let LogBehind { shown, known } = behind;
                Self::RolledBack(format!(
                    "ROLLED BACK: the log shows {shown} entries, but {known} were seen before, and it did not come back in time"
                ))
            })
        })
    }
}

/// Whether a file was written less than `time` ago; `false` if unknown.
pub(crate) fn is_recent(file: &Path, time: Duration) -> bool {
    let written = fs::metadata(file).and_then(|file| file.modified());
    // For a clock that was set back since then, no time has passed.
    written.is_ok_and(|at| at.elapsed().unwrap_or_default() < time)
}
