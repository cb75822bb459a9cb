//! How to replay a ledger, and where to keep what was replayed.

use super::saved::Saved;
use std::{num::NonZeroUsize, path::PathBuf, time::Duration};
use zk0_circuits::Digest;

/// How to replay.
#[derive(Default)]
pub struct Options<'a> {
    /// The network that it has to be.
    pub network: Option<Digest>,
    /// How many threads; when absent, one more than there are cores, since one may wait for its turn.
    pub threads: Option<NonZeroUsize>,
    /// Is told now and then how many entries are verified, and of how many.
    pub progress: Option<&'a (dyn Fn(u64, u64) + Sync)>,
    /// What an earlier replay verified: this one goes on from there, and the log has to continue it.
    pub from: Option<Saved>,
    /// Where to keep what is verified, for a later replay.
    pub keep: Option<Keep>,
}

/// Where to keep a replay, and how often to write it. It is written at the end in any case.
#[derive(Clone, Debug)]
pub struct Keep {
    /// The file.
    pub path: PathBuf,
    /// The least time between two writes: what a replay that is killed loses.
    pub every: Duration,
}
