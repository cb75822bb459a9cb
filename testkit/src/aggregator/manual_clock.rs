//! The tests' clock.

use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;
use zk0_aggregator::Clock;

/// Moves only by the test.
#[derive(Debug, Default)]
pub struct ManualClock {
    shown_ms: AtomicU64,
    passed_ms: AtomicU64,
}

impl ManualClock {
    /// Shows `now_ms`.
    pub fn at(now_ms: u64) -> Self {
        Self {
            shown_ms: AtomicU64::new(now_ms),
            passed_ms: AtomicU64::new(0),
        }
    }

    /// Lets time pass.
    pub fn advance(&self, by_ms: u64) {
        self.passed_ms.fetch_add(by_ms, Ordering::SeqCst);
        self.set_forward(by_ms);
    }

    /// Sets the clock.
    pub fn jump(&self, by_ms: i64) {
        let moved = |shown_ms: u64| Some(shown_ms.saturating_add_signed(by_ms));
        let _ = self
            .shown_ms
            .fetch_update(Ordering::SeqCst, Ordering::SeqCst, moved);
    }

    /// Sets the clock forward.
    pub fn set_forward(&self, by_ms: u64) {
        self.shown_ms.fetch_add(by_ms, Ordering::SeqCst);
    }
}

impl Clock for ManualClock {
    fn now_ms(&self) -> u64 {
        self.shown_ms.load(Ordering::SeqCst)
    }

    fn steady(&self) -> Duration {
        Duration::from_millis(self.passed_ms.load(Ordering::SeqCst))
    }
}
