//! How to replay a ledger, and where to keep what was replayed.

use super::database::OpenedDatabase;
use super::saved::SavedReplay;
use std::num::NonZeroUsize;
use std::path::PathBuf;
use std::time::Duration;
use zk0_circuits::Digest;
use zk0_protocol::tlog::checkpoint::Checkpoint;

/// Options of a replay.
#[derive(Default)]
pub struct ReplayOptions<'a> {
    /// What [`super::open`] opened; `None` to open the database first.
    pub opened: Option<OpenedDatabase>,
    /// The log has to be of this network.
    pub network: Option<Digest>,
    /// How many threads are used. Without a value there is one more than there are cores, because one may be waiting for its turn.
    pub threads: Option<NonZeroUsize>,
    /// Is called from time to time with the number of verified entries and the number of all entries.
    pub progress: Option<&'a (dyn Fn(u64, u64) + Sync)>,
    /// An earlier replay. This one goes on from there, and the log has to continue what was verified then.
    pub from: Option<SavedReplay>,
    /// An earlier replay from which this one cannot go on, because the caller's own checks were others. This one starts with the genesis,
    /// and the log has to continue what was verified then.
    pub known: Option<SavedReplay>,
    /// What the caller has seen of the log before, whether or not that could be saved. The log has to continue it, too.
    pub seen: Option<Checkpoint>,
    /// Where the result is saved, so that a later replay can go on from it.
    pub keep: Option<SaveOptions>,
}

/// Where a replay is saved, and how often. It is always saved at the end. If that fails, [`super::ReplayReport::unsaved`] says so.
#[derive(Clone, Debug)]
pub struct SaveOptions {
    /// The file.
    pub path: PathBuf,
    /// The shortest time between two writes. A replay that is killed loses the work of about this time.
    pub every: Duration,
}
