//! Progress of long work, as tracing events, which a terminal or a parent process shows as bars.

use std::time::{Duration, Instant};

/// Target of the events. Their fields are `phase`, `done`, `total` and `eta_ms`.
pub const TARGET: &str = "zk0::progress";

/// Work in units that take about the same time each.
#[derive(Debug)]
pub struct Progress {
    phase: &'static str,
    total: u64,
    started: Instant,
    reported: Option<Instant>,
}

impl Progress {
    /// Starts `total` units of work.
    pub fn start(phase: &'static str, total: u64) -> Self {
        Self {
            phase,
            total,
            started: Instant::now(),
            reported: None,
        }
    }

    /// Reports that `done` units are done: at most twice a second, and always at the end.
    pub fn reached(&mut self, done: u64) {
        let finished = done >= self.total;
        if !finished
            && self
                .reported
                .is_some_and(|at| at.elapsed() < Duration::from_millis(500))
        {
            return;
        }
        self.reported = Some(Instant::now());
        let left = self.total.saturating_sub(done) as f64 / done.max(1) as f64;
        let eta_ms = self.started.elapsed().mul_f64(left).as_millis() as u64;
        report(self.phase, done, self.total, eta_ms);
    }
}

/// Emits one progress event.
pub fn report(phase: &str, done: u64, total: u64, eta_ms: u64) {
    tracing::info!(target: TARGET, phase, done, total, eta_ms);
}
