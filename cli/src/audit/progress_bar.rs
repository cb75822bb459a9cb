//! Shows how far an audit is.

use crate::logging::PROGRESS;
use std::sync::Mutex;
use std::time::{Duration, Instant};

/// Reports progress a few times a second.
#[derive(Default)]
pub struct Bar(Mutex<Option<Reported>>);

struct Reported {
    begun: Instant,
    last: Instant,
    first: u64,
    most: u64,
}

impl Bar {
    /// `done` of `total` entries are verified. Threads may call this in any order.
    pub fn at(&self, done: u64, total: u64) {
        const PAUSE: Duration = Duration::from_millis(200);
        let now = Instant::now();
        let Ok(mut reported) = self.0.lock() else {
            return;
        };
        let reported = reported.get_or_insert(Reported {
            begun: now,
            last: now,
            first: done,
            most: done,
        });
        // The end is always reported, so that no bar stays.
        let early = now < reported.last + PAUSE && done < total;
        if early || done < reported.most {
            return;
        }
        (reported.last, reported.most) = (now, done);
        let elapsed = now.duration_since(reported.begun).as_secs_f64();
        let rate = (done - reported.first) as f64 / elapsed.max(0.001);
        let eta_ms = (rate > 0.0).then(|| (total.saturating_sub(done) as f64 / rate * 1e3) as u64);
        tracing::info!(target: PROGRESS, phase = "auditing", done, total, eta_ms);
    }
}
