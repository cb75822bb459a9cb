//! An auditor's replay: read a ledger's folder from the first byte, believe nothing, and report.
//!
//! What depends on one entry alone ([`chunk`]: reading, decoding, signatures) is done by several threads; what depends on the
//! entries before it ([`serial`]: tree, rules, the caller's own checks) by whichever thread's turn it is, in order. Each thread
//! holds one chunk: memory does not grow with the log, but for what the network's state itself remembers. What is found does
//! not depend on the number of threads.
//!
//! - [`report`]: what is said at the end; [`database`]: which database is read;
//! - [`saved`]: a replay on disk, from which a later one goes on.

mod chunk;
mod database;
mod report;
mod saved;
mod serial;

pub use report::{Finding, Report, Severity, Verdict};
pub use saved::{Saved, SavedError};

use crate::{blobs::Blobs, error::LedgerError, store::Store};
use chunk::{Chunk, CHUNK};
use serial::Serial;
use std::{
    num::NonZeroUsize,
    path::{Path, PathBuf},
    sync::{
        atomic::{AtomicU64, Ordering},
        Arc, Condvar, Mutex, MutexGuard, PoisonError,
    },
    thread,
    time::Duration,
};
use zk0_circuits::Digest;
use zk0_protocol::{entries::known_keys::KnownKeys, Entry, Genesis, State};

/// What else an auditor checks, entry by entry: proofs, refusals, aggregation. The ledger itself has checked bytes, tree
/// and checkpoint by then. The calls come one after the other, though not all from one thread.
pub trait Recheck: Send {
    /// How many entries there will be.
    fn begin(&mut self, _entries: u64) {}

    /// The founding document.
    fn genesis(&mut self, _genesis: &Genesis, _blobs: &Blobs) -> Vec<Finding> {
        Vec::new()
    }

    /// An entry that the rules allow after `before`. What takes long may be left to other threads: findings are those of this
    /// entry and of entries before it, in order.
    fn entry(
        &mut self,
        _before: &State,
        _index: u64,
        _entry: &Entry,
        _blobs: &Blobs,
    ) -> Vec<Finding> {
        Vec::new()
    }

    /// Waits for what was left to other threads, and gives all findings that are still to come.
    fn settle(&mut self) -> Vec<Finding> {
        Vec::new()
    }

    /// What another process has to know to go on from here. Comes after [`Recheck::settle`].
    fn save(&self) -> Vec<u8> {
        Vec::new()
    }

    /// What there is to say of the whole, at the end.
    fn summary(&mut self) -> Vec<Finding> {
        Vec::new()
    }
}

/// Checks the ledger alone.
impl Recheck for () {}

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

/// Replays the ledger in `dir`, which may be a read-only copy or in use. If `network` is given it has to be that one.
pub fn replay(dir: &Path, network: Option<&Digest>, recheck: &mut dyn Recheck) -> Report {
    let options = Options {
        network: network.copied(),
        ..Options::default()
    };
    replay_with(dir, options, recheck)
}

/// [`replay`], with a say in how.
pub fn replay_with(dir: &Path, options: Options<'_>, recheck: &mut dyn Recheck) -> Report {
    let threads = options
        .threads
        .map_or_else(default_threads, NonZeroUsize::get);
    let progress = options.progress;
    let mut serial = Serial::new(dir, options, recheck);
    let stopped = run(dir, threads, progress, &mut serial).err();
    serial.report(stopped)
}

fn default_threads() -> usize {
    thread::available_parallelism().map_or(2, |cores| cores.get() + 1)
}

fn run(
    dir: &Path,
    threads: usize,
    progress: Option<&(dyn Fn(u64, u64) + Sync)>,
    serial: &mut Serial<'_>,
) -> Result<(), Finding> {
    let fault = |error: LedgerError| Finding::fault(None, error.to_string());
    let (store, size) = database::open_published(dir).map_err(fault)?;
    database::check_keys(&store, size)?;
    let first = serial.begin(&store, size)?;
    let genesis = serial.genesis().cloned();
    let relay = Relay {
        store: &store,
        entries: first..size,
        genesis: genesis.as_ref(),
        next: AtomicU64::new(0),
        progress,
        track: Mutex::new(Track {
            serial,
            turn: 0,
            stop: None,
        }),
        turned: Condvar::new(),
    };
    thread::scope(|scope| {
        for _ in 1..threads {
            scope.spawn(|| relay.run());
        }
        relay.run();
    });
    let track = relay.track.into_inner();
    match track.unwrap_or_else(PoisonError::into_inner).stop {
        Some(Stop::Fault(fault)) => Err(fault),
        Some(Stop::Panic) => Err(Finding::fault(None, "the replay gave up: see its log")),
        None => Ok(()),
    }
}

/// Chunks of entries go through several threads at once; their serial part in order, handed on from thread to thread.
struct Relay<'a, 'b> {
    store: &'a Store,
    entries: std::ops::Range<u64>,
    genesis: Option<&'a Genesis>,
    /// The next chunk that nobody has taken.
    next: AtomicU64,
    progress: Option<&'a (dyn Fn(u64, u64) + Sync)>,
    track: Mutex<Track<'a, 'b>>,
    /// Somebody else's turn has come, or nobody's.
    turned: Condvar,
}

struct Track<'a, 'b> {
    serial: &'a mut Serial<'b>,
    /// The chunk whose serial part is next.
    turn: u64,
    stop: Option<Stop>,
}

enum Stop {
    /// An entry that cannot be gone past.
    Fault(Finding),
    /// A thread ended: the others must not wait for it.
    Panic,
}

impl<'a, 'b> Relay<'a, 'b> {
    fn run(&self) {
        let alarm = Alarm(self);
        loop {
            let number = self.next.fetch_add(1, Ordering::Relaxed);
            let start = self
                .entries
                .start
                .saturating_add(number.saturating_mul(CHUNK));
            let end = start.saturating_add(CHUNK).min(self.entries.end);
            let Some(keys) = self.keys().filter(|_| start < end) else {
                break;
            };
            let chunk = Chunk::read(self.store, start..end, self.genesis);
            let authentic = chunk.authenticate(&keys);
            drop(keys);
            let mut track = self.lock();
            while track.turn != number && track.stop.is_none() {
                track = self
                    .turned
                    .wait(track)
                    .unwrap_or_else(PoisonError::into_inner);
            }
            if track.stop.is_some() {
                break;
            }
            if let Err(fault) = track.serial.take(&chunk, &authentic) {
                track.stop = Some(Stop::Fault(fault));
            }
            track.turn += 1;
            drop(track);
            self.turned.notify_all();
            if let Some(progress) = self.progress {
                progress(end, self.entries.end);
            }
        }
        drop(alarm);
    }

    /// The keys that are known now; `None` once the replay has stopped.
    fn keys(&self) -> Option<Arc<KnownKeys>> {
        let track = self.lock();
        track.stop.is_none().then(|| track.serial.keys())
    }

    fn lock(&self) -> MutexGuard<'_, Track<'a, 'b>> {
        self.track.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Tells the other threads when this one ends by a panic.
struct Alarm<'r, 'a, 'b>(&'r Relay<'a, 'b>);

impl Drop for Alarm<'_, '_, '_> {
    fn drop(&mut self) {
        if thread::panicking() {
            self.0.lock().stop = Some(Stop::Panic);
            self.0.turned.notify_all();
        }
    }
}
