//! A replay on several threads: each prepares chunks, and the serial part passes from thread to thread, in order.

use super::chunk::{Chunk, CHUNK};
use super::database::{self, OpenedDatabase};
use super::report::Finding;
use super::serial::Serial;
use crate::error::LedgerError;
use crate::store::Store;
use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread;
use zk0_protocol::entries::known_keys::KnownKeys;
use zk0_protocol::Genesis;

/// Replays with so many threads, and stops at the first entry that it cannot verify.
pub fn run(
    dir: &Path,
    opened: Option<OpenedDatabase>,
    threads: usize,
    progress: Option<&(dyn Fn(u64, u64) + Sync)>,
    serial: &mut Serial<'_>,
) -> Result<(), Finding> {
    let stops = |error: LedgerError| Finding::of_error(None, &error);
    let OpenedDatabase { store, size } = match opened {
        Some(opened) => opened,
        None => database::open_published(dir).map_err(stops)?,
    };
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
        Some(Stop::At(why)) => Err(why),
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
    /// An entry is not valid, or it cannot be read. So nothing can be said of those after it.
    At(Finding),
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
            if let Err(why) = track.serial.take(&chunk, &authentic) {
                track.stop = Some(Stop::At(why));
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
