//! Whether the writer's clock is right. Deadlines and votes end by the times of entries, which never go back: one entry from the far future
//! would end all of them for good. So a writer compares its clock with one that cannot be set.
//!
//! A clock that jumps back is noticed, too: no deadline would pass meanwhile. After a small step back, an entry gets its predecessor's
//! time. A clock that was ahead before the ledger opened is not noticed.

use std::fmt;
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

/// How much the two clocks may differ, in milliseconds.
pub const TOLERANCE_MS: u64 = 60_000;

/// How often the watch adopts a right clock's time, so that a time service's small steps do not add up.
const FOLLOW: Duration = Duration::from_secs(3600);

/// Why the clock seems to be wrong.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ClockError {
    /// The clock shows a time before the last entry.
    #[error(
        "the clock shows {clock_ms} (Unix milliseconds), which is {} s before the last entry, of {last_ms}. Set the clock. \
         If the clock is right, the entry's time is wrong: wait until that time is over",
        (last_ms - clock_ms) / 1000
    )]
    Behind { clock_ms: u64, last_ms: u64 },
    /// The clock has moved further than time has passed.
    #[error(
        "the clock shows {clock_ms} (Unix milliseconds), but by the time since the ledger was opened it should show \
         {expected_ms}: it is {} s ahead. An entry with such a time could not be undone, so none is recorded. Set the clock. If it \
         is right now, start this program again",
        (clock_ms - expected_ms) / 1000
    )]
    LeaptAhead { clock_ms: u64, expected_ms: u64 },
    /// The clock has moved less far than time has passed.
    #[error(
        "the clock shows {clock_ms} (Unix milliseconds), but by the time since the ledger was opened it should show \
         {expected_ms}: it is {} s behind. No deadline would pass by it, so nothing is recorded. Set the clock. If it is right now, \
         start this program again",
        (expected_ms - clock_ms) / 1000
    )]
    LeaptBack { clock_ms: u64, expected_ms: u64 },
}

/// Compares the clock with one that cannot be set.
pub struct ClockWatch {
    right: Mutex<Right>,
    read: Box<dyn Fn() -> Duration + Send + Sync>,
}

/// What the two clocks showed when the first was right.
#[derive(Clone, Copy, Debug)]
struct Right {
    clock_ms: u64,
    steady: Duration,
}

impl fmt::Debug for ClockWatch {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("ClockWatch")
            .field("right", &self.right)
            .finish_non_exhaustive()
    }
}

impl ClockWatch {
    /// Begins with the clock at `clock_ms` and the last entry at `last_ms`, in Unix milliseconds. `read` reads the second clock: the time
    /// since some past moment, such as Linux' `CLOCK_BOOTTIME`, which also runs while a machine sleeps.
    pub fn begin(
        clock_ms: u64,
        last_ms: u64,
        read: impl Fn() -> Duration + Send + Sync + 'static,
    ) -> Result<Self, ClockError> {
        if last_ms.saturating_sub(clock_ms) > TOLERANCE_MS {
            Err(ClockError::Behind { clock_ms, last_ms })
        } else {
            Ok(Self {
                right: Mutex::new(Right {
                    clock_ms,
                    steady: read(),
                }),
                read: Box::new(read),
            })
        }
    }

    /// Checks that the clock, at `clock_ms` now, is neither ahead nor behind.
    pub fn check_now(&self, clock_ms: u64) -> Result<(), ClockError> {
        // The lock covers this reading, too, so that no thread goes back to an older one.
        let mut right = self.right.lock().unwrap_or_else(PoisonError::into_inner);
        let steady = (self.read)();
        let expected_ms = right.expected(steady);
        ahead(clock_ms, expected_ms)?;
        if expected_ms.saturating_sub(clock_ms) > TOLERANCE_MS {
            return Err(ClockError::LeaptBack {
                clock_ms,
                expected_ms,
            });
        }
        if steady.saturating_sub(right.steady) >= FOLLOW {
            *right = Right { clock_ms, steady };
        }
        Ok(())
    }

    /// Checks that the clock was not ahead at `time_ms`, read now or earlier for an entry.
    pub fn check(&self, time_ms: u64) -> Result<(), ClockError> {
        let right = *self.right.lock().unwrap_or_else(PoisonError::into_inner);
        ahead(time_ms, right.expected((self.read)()))
    }
}

impl Right {
    /// What the clock should show at `steady` on the second one.
    fn expected(&self, steady: Duration) -> u64 {
        let passed = steady.saturating_sub(self.steady);
        let passed = u64::try_from(passed.as_millis()).unwrap_or(u64::MAX);
        self.clock_ms.saturating_add(passed)
    }
}

fn ahead(clock_ms: u64, expected_ms: u64) -> Result<(), ClockError> {
    if clock_ms.saturating_sub(expected_ms) > TOLERANCE_MS {
        Err(ClockError::LeaptAhead {
            clock_ms,
            expected_ms,
        })
    } else {
        Ok(())
    }
}
