//! How long to wait before a server that does not answer is asked again: longer with each attempt. The waits of many clients differ, so they do
//! not all ask a server that comes back at the same moment.

use std::time::Duration;

/// Each further wait may be longer by this factor.
const GROWTH: f64 = 1.5;

/// Waits that grow with the attempts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct GrowingWaits {
    /// The first wait is at most this long.
    pub first: Duration,
    /// Further waits grow up to this.
    pub longest: Duration,
}

impl GrowingWaits {
    /// The wait before an attempt, counted from 0. `random` draws it between half and the whole of a time that grows with the attempts. The
    /// half is at least what the server has `told`.
    pub fn wait(&self, attempt: u32, random: u32, told: Duration) -> Duration {
        let grown = self.first.as_secs_f64() * GROWTH.powf(f64::from(attempt));
        let grown = Duration::from_secs_f64(grown.min(self.longest.as_secs_f64()));
        let half = (grown / 2).max(told);
        half + half.mul_f64(f64::from(random) / f64::from(u32::MAX))
    }
}
