//! How to replay a ledger, and where to save the replay.

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
    /// From [`super::open`]; `None` to open the database first.
    pub opened: Option<OpenedDatabase>,
    /// The log must be of this network.
    pub network: Option<Digest>,
    /// The number of threads. Default: the cores and one, because one may wait for its turn.
    pub threads: Option<NonZeroUsize>,
    /// Called now and then with the numbers of verified and of all entries.
    pub progress: Option<&'a (dyn Fn(u64, u64) + Sync)>,
    /// An earlier replay to go on from. The log must continue it.
    pub from: Option<SavedReplay>,
    /// An earlier replay with other checks of the caller. This one starts over. The log must continue the earlier one.
    pub known: Option<SavedReplay>,
    /// What the caller has seen of the log, saved or not. The log must continue it.
    pub seen: Option<Checkpoint>,
    /// Where the result is saved, for a later replay.
    pub keep: Option<SaveOptions>,
}

/// Where and how often a replay is saved, besides at the end. [`super::ReplayReport::unsaved`] names a failure.
#[derive(Clone, Debug)]
pub struct SaveOptions {
    /// The file.
    pub path: PathBuf,
    /// The shortest time between writes: about the work that a killed replay loses.
    pub every: Duration,
}
