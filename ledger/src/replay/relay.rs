//! A replay on several threads: each prepares chunks, and the serial part passes between them in order.

use super::chunk::{Chunk, CHUNK};
use super::stopped::Stopped;
use super::verified::{HistoryFold, VerifiedHistory};
use crate::store::Store;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread;
use zk0_protocol::entries::known_keys::KnownKeys;
use zk0_protocol::Genesis;

/// Verifies `history` to the end of its log of `whole` entries, or to the first entry that fails, with so many threads.
pub fn run(
    store: &Store,
    whole: u64,
    history: &mut VerifiedHistory,
    fold: &mut dyn HistoryFold,
    threads: usize,
    progress: Option<&(dyn Fn(u64, u64) + Sync)>,
) -> Result<(), Stopped> {
    history.is_of(store, whole)?;
    let genesis = history.genesis().clone();
    let relay = Relay {
        store,
        entries: history.size()..whole,
        genesis: &genesis,
        next: AtomicU64::new(0),
        progress,
        track: Mutex::new(Track {
            history,
            fold,
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
    let Track { history, stop, .. } = track.unwrap_or_else(PoisonError::into_inner);
    match stop {
        Some(Stop::At(why)) => Err(why),
        Some(Stop::Panic) => Err(Stopped::bad(
            history.size(),
            "a thread of the replay has failed: see the program's log",
        )),
        None => Ok(()),
    }
}

/// The cores and one, because one thread may wait for its turn.
pub fn default_threads() -> usize {
    thread::available_parallelism().map_or(2, |cores| cores.get() + 1)
}

struct Relay<'a> {
    store: &'a Store,
    entries: std::ops::Range<u64>,
    genesis: &'a Genesis,
    /// The next chunk that no thread has taken.
    next: AtomicU64,
    progress: Option<&'a (dyn Fn(u64, u64) + Sync)>,
    track: Mutex<Track<'a>>,
    /// Wakes waiting threads at the next chunk's turn, and at a stop.
    turned: Condvar,
}

struct Track<'a> {
    history: &'a mut VerifiedHistory,
    fold: &'a mut dyn HistoryFold,
    /// The chunk whose serial part is next.
    turn: u64,
    stop: Option<Stop>,
}

enum Stop {
    /// An entry is invalid or unreadable, so later ones are unknown.
    At(Stopped),
    /// A thread has panicked. The others must not wait for it.
    Panic,
}

impl<'a> Relay<'a> {
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
            let chunk = Chunk::read(self.store, start..end, Some(self.genesis));
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
            let Track { history, fold, .. } = &mut *track;
            let taken = history.take(&chunk, &authentic, &mut **fold);
            match taken.and(chunk.broken.map_or(Ok(()), Err)) {
                Ok(()) => fold.pause(history),
                Err(why) => track.stop = Some(Stop::At(why)),
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

    /// The keys known now; `None` after a stop.
    fn keys(&self) -> Option<Arc<KnownKeys>> {
        let track = self.lock();
        track.stop.is_none().then(|| track.history.keys())
    }

    fn lock(&self) -> MutexGuard<'_, Track<'a>> {
        self.track.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Stops the other threads when this one panics.
struct Alarm<'r, 'a>(&'r Relay<'a>);

impl Drop for Alarm<'_, '_> {
    fn drop(&mut self) {
        if thread::panicking() {
            self.0.lock().stop = Some(Stop::Panic);
            self.0.turned.notify_all();
        }
    }
}
