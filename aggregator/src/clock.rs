//! The aggregator's clock, which alone decides on deadlines.

use std::fs;
use std::sync::OnceLock;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

/// Tells the time, in Unix milliseconds.
pub trait Clock: Send + Sync {
    /// Now.
    fn now_ms(&self) -> u64;

    /// Time by a clock that cannot be set and goes on while the machine sleeps.
    fn steady(&self) -> Duration;
}

/// The machine's clock.
#[derive(Clone, Copy, Debug, Default)]
pub struct SystemClock;

impl Clock for SystemClock {
    fn now_ms(&self) -> u64 {
        SystemTime::now()
            .duration_since(UNIX_EPOCH)
            .map_or(0, |since| since.as_millis() as u64)
    }

    /// Linux' `/proc/uptime`, which counts sleep; elsewhere [`Instant`], which may not.
    fn steady(&self) -> Duration {
        static STARTED: OnceLock<(Instant, Option<Duration>)> = OnceLock::new();
        let (started, at_start) = STARTED.get_or_init(|| (Instant::now(), uptime()));
        match (at_start, uptime()) {
            (Some(_), Some(uptime)) => uptime,
            (at_start, _) => at_start.unwrap_or_default() + started.elapsed(),
        }
    }
}

fn uptime() -> Option<Duration> {
    let text = fs::read_to_string("/proc/uptime").ok()?;
    let seconds: f64 = text.split_whitespace().next()?.parse().ok()?;
    Duration::try_from_secs_f64(seconds).ok()
}
