//! The processor time of this thread: what a computation costs, whatever else the machine does meanwhile.

use std::{fs, time::Instant};

/// A point in time.
pub struct Clock {
    wall: Instant,
    processor: Option<u64>,
}

/// Nanoseconds this thread has run, where the system tells (Linux).
fn processor() -> Option<u64> {
    fs::read_to_string("/proc/thread-self/schedstat").ok()?.split(' ').next()?.parse().ok()
}

impl Clock {
    /// Now.
    pub fn start() -> Self {
        Self { wall: Instant::now(), processor: processor() }
    }

    /// Seconds of processor time since then; of wall-clock time where the system does not tell.
    pub fn seconds(&self) -> f64 {
        match (self.processor, processor()) {
            (Some(start), Some(now)) => (now - start) as f64 / 1e9,
            _ => self.wall.elapsed().as_secs_f64(),
        }
    }
}
