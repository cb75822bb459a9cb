//! An auditor's replay: it reads a ledger's folder from the first byte, verifies everything, and reports.
//!
//! Several threads do the part that needs only one entry ([`chunk`]: reading, decoding, signatures). The part that needs the entries before
//! it ([`serial`]: tree, rules, the caller's own checks) is done in order, by one thread at a time. Each thread holds one chunk, so
//! only the network's state grows with the log. The findings do not depend on the number of threads.
//!
//! - [`report`]: the report at the end; [`database`]: how the database is opened and checked;
//! - [`saved`]: a replay on disk, from which a later replay goes on.

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

/// The checks that an auditor adds to each entry: proofs, refusals, aggregation. The replay has verified the entry's bytes, the tree and
/// the checkpoint before it calls these functions. The calls come one after the other, though not all from the same thread.
pub trait Recheck: Send {
    /// The replay begins, and the log has so many entries.
    fn begin(&mut self, _entries: u64) {}

    /// Checks the genesis.
    fn genesis(&mut self, _genesis: &Genesis, _blobs: &Blobs) -> Vec<Finding> {
        Vec::new()
    }

    /// Checks an entry that the rules allow in the state `before`. Long checks may be left to other threads, so the result is findings about
    /// this entry and about entries before it, in order.
    fn entry(
        &mut self,
        _before: &State,
        _index: u64,
        _entry: &Entry,
        _blobs: &Blobs,
    ) -> Vec<Finding> {
        Vec::new()
    }

    /// Waits for the checks that were left to other threads, and returns their findings.
    fn settle(&mut self) -> Vec<Finding> {
        Vec::new()
    }

    /// The state that another process needs to go on from here. It is asked for after [`Recheck::settle`].
    fn save(&self) -> Vec<u8> {
        Vec::new()
    }

    /// Findings about the whole log, at the end.
    fn summary(&mut self) -> Vec<Finding> {
        Vec::new()
    }
}

/// No checks beyond the ledger's own.
impl Recheck for () {}

/// Options of a replay.
#[derive(Default)]
pub struct Options<'a> {
    /// The log has to be of this network.
    pub network: Option<Digest>,
    /// How many threads are used. Without a value there is one more than there are cores, because one may be waiting for its turn.
    pub threads: Option<NonZeroUsize>,
    /// Is called from time to time with the number of verified entries and the number of all entries.
    pub progress: Option<&'a (dyn Fn(u64, u64) + Sync)>,
    /// An earlier replay. This one goes on from there, and the log has to continue what was verified then.
    pub from: Option<Saved>,
    /// Where the result is saved, so that a later replay can go on from it.
    pub keep: Option<Keep>,
}

/// Where a replay is saved, and how often. It is always saved at the end.
#[derive(Clone, Debug)]
pub struct Keep {
    /// The file.
    pub path: PathBuf,
    /// The shortest time between two writes. A replay that is killed loses the work of about this time.
    pub every: Duration,
}

/// Replays the ledger in `dir`, which may be a read-only copy, or in use. If `network` is given, the ledger has to be of that network.
pub fn replay(dir: &Path, network: Option<&Digest>, recheck: &mut dyn Recheck) -> Report {
    let options = Options {
        network: network.copied(),
        ..Options::default()
    };
    replay_with(dir, options, recheck)
}

/// Replays the ledger in `dir` with these options; see [`replay`].
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
        Some(Stop::Panic) => Err(Finding::fault(
            None,
            "a thread of the replay has failed: see the program's log",
        )),
        None => Ok(()),
    }
}

/// Distributes chunks of entries to several threads, which do the serial part in the order of the chunks.
struct Relay<'a, 'b> {
    store: &'a Store,
    entries: std::ops::Range<u64>,
    genesis: Option<&'a Genesis>,
    /// The next chunk that no thread has taken.
    next: AtomicU64,
    progress: Option<&'a (dyn Fn(u64, u64) + Sync)>,
    track: Mutex<Track<'a, 'b>>,
    /// Wakes the waiting threads when the next chunk's turn has come, and when the replay stops.
    turned: Condvar,
}

struct Track<'a, 'b> {
    serial: &'a mut Serial<'b>,
    /// The chunk whose serial part is next.
    turn: u64,
    stop: Option<Stop>,
}

enum Stop {
    /// An entry is not valid, so nothing after it can be.
    Fault(Finding),
    /// A thread has panicked, and the others must not wait for it.
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

/// Stops the other threads when this one panics.
struct Alarm<'r, 'a, 'b>(&'r Relay<'a, 'b>);

impl Drop for Alarm<'_, '_, '_> {
    fn drop(&mut self) {
        if thread::panicking() {
            self.0.lock().stop = Some(Stop::Panic);
            self.0.turned.notify_all();
        }
    }
}
