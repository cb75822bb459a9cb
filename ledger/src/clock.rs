//! Whether the clock can be believed. Deadlines and votes end by the times of entries, and those never go back: an entry from
//! the far future would end them all at once and could never be taken back. So a writer holds its clock against another one
//! that nobody sets.
//!
//! What this cannot notice: a clock that was wrong before the ledger was opened, and ahead. Small steps back are absorbed: an
//! entry gets the time of the one before.

use std::{fmt, time::Duration};

/// How far the clock may be off, in milliseconds.
pub const TOLERANCE_MS: u64 = 60_000;

/// Why the clock is not believed.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ClockError {
    /// Before the last entry.
    #[error(
        "the clock shows {clock_ms} (Unix milliseconds), {} s before the last entry, recorded at {last_ms}: either is wrong. Set the \
         clock; if it is right, wait until it is past that entry",
        (last_ms - clock_ms) / 1000
    )]
    Behind { clock_ms: u64, last_ms: u64 },
    /// Further than time has passed.
    #[error(
        "the clock shows {clock_ms} (Unix milliseconds), but by the time that has passed since the ledger was opened it should show \
         {expected_ms}: it leapt {} s ahead, and what is recorded with such a time cannot be taken back. Set the clock; if it is \
         right now, open the ledger again",
        (clock_ms - expected_ms) / 1000
    )]
    LeaptAhead { clock_ms: u64, expected_ms: u64 },
}

/// Compares a clock that can be set with one that cannot.
pub struct ClockWatch {
    /// What the clock showed at first, Unix milliseconds.
    clock_ms: u64,
    /// What the other one showed then.
    steady: Duration,
    read: Box<dyn Fn() -> Duration + Send + Sync>,
}

impl fmt::Debug for ClockWatch {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("ClockWatch")
            .field("clock_ms", &self.clock_ms)
            .field("steady", &self.steady)
            .finish_non_exhaustive()
    }
}

impl ClockWatch {
    /// Begins now, when the clock shows `clock_ms` and the last entry is of `last_ms`, both in Unix milliseconds. `read` gives
    /// the time since some moment in the past, and nobody sets it: on Linux `CLOCK_BOOTTIME`, which goes on while a machine
    /// sleeps.
    pub fn begin(
        clock_ms: u64,
        last_ms: u64,
        read: impl Fn() -> Duration + Send + Sync + 'static,
    ) -> Result<Self, ClockError> {
        match last_ms.saturating_sub(clock_ms) > TOLERANCE_MS {
            true => Err(ClockError::Behind { clock_ms, last_ms }),
            false => Ok(Self {
                clock_ms,
                steady: read(),
                read: Box::new(read),
            }),
        }
    }

    /// Whether the clock may show `clock_ms` now.
    pub fn check(&self, clock_ms: u64) -> Result<(), ClockError> {
        let passed = (self.read)().saturating_sub(self.steady);
        let passed = u64::try_from(passed.as_millis()).unwrap_or(u64::MAX);
        let expected_ms = self.clock_ms.saturating_add(passed);
        match clock_ms.saturating_sub(expected_ms) > TOLERANCE_MS {
            true => Err(ClockError::LeaptAhead {
                clock_ms,
                expected_ms,
            }),
            false => Ok(()),
        }
    }
}
