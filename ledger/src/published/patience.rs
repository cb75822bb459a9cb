//! When a reader asks a file's server again, and when it gives up.
//!
//! | what went wrong | the reader |
//! |---|---|
//! | broken connection; status 408, 429, 502, 504; status 503 with `Retry-After` | asks again with growing waits, half a minute in all |
//! | status 503 alone: perhaps nothing is published yet | asks twice again, within two seconds |
//! | less than [`LEAST_BYTES`] within [`WITHIN`] of waiting | gives up |
//! | anything else | gives up |
//!
//! The waits start over when bytes come. The third row limits a server that sends a byte now and then.

use std::time::Duration;

/// The wait before each try, while nothing comes.
const WAITS: [Duration; 6] = [
    Duration::from_millis(500),
    Duration::from_secs(1),
    Duration::from_secs(2),
    Duration::from_secs(4),
    Duration::from_secs(8),
    Duration::from_secs(12),
];

/// The longest sum of waits, if the server asks for longer ones.
const ALL_WAITS: Duration = Duration::from_secs(29);

/// Tries while the server is unavailable and names no time.
const UNAVAILABLE: usize = 2;

/// This many bytes must come, or the end of the file, ...
pub(super) const LEAST_BYTES: u64 = 16 << 20;

/// ... within this time of waiting.
pub(super) const WITHIN: Duration = Duration::from_secs(600);

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum FailedRequest {
    /// It may pass, perhaps at the server's time `again`.
    Passing {
        again: Option<Duration>,
    },
    /// The server is unavailable and names no time.
    Unavailable,
    ForGood,
}

#[derive(Debug, Default)]
pub(super) struct RetryBudget {
    tries: usize,
    unavailable: usize,
    waits: Duration,
    came: u64,
    took: Duration,
}

impl RetryBudget {
    /// The wait before the next try; `None` to give up.
    pub fn next_wait(&mut self, failed: FailedRequest) -> Option<Duration> {
        let step = *WAITS.get(self.tries)?;
        let wait = match failed {
            FailedRequest::Passing { again } => step.max(again.unwrap_or_default()),
            FailedRequest::Unavailable if self.unavailable < UNAVAILABLE => {
                self.unavailable += 1;
                step
            }
            FailedRequest::Unavailable | FailedRequest::ForGood => return None,
        };
        let waits = self.waits.saturating_add(wait);
        if waits > ALL_WAITS {
            return None;
        }
        self.tries += 1;
        self.waits = waits;
        Some(wait)
    }

    /// New bytes came: the waits start over.
    pub fn progress(&mut self) {
        (self.tries, self.unavailable, self.waits) = (0, 0, Duration::ZERO);
    }

    /// Counts new `bytes` and the wait for them. Returns whether that is fast enough.
    pub fn keeps_pace(&mut self, bytes: u64, took: Duration) -> bool {
        self.came = self.came.saturating_add(bytes);
        self.took = self.took.saturating_add(took);
        if self.came >= LEAST_BYTES {
            (self.came, self.took) = (0, Duration::ZERO);
        }
        self.took < WITHIN
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::iter::from_fn;

    const BROKEN: FailedRequest = FailedRequest::Passing { again: None };

    fn waits(patience: &mut RetryBudget, failed: FailedRequest) -> Vec<u64> {
        let waits = from_fn(|| patience.next_wait(failed));
        waits.map(|wait| wait.as_millis() as u64).collect()
    }

    #[test]
    fn the_waits_grow_and_end_and_begin_anew_with_each_progress() {
        let mut patience = RetryBudget::default();
        let all = [500, 1000, 2000, 4000, 8000, 12_000];
        assert_eq!(waits(&mut patience, BROKEN), all);
        assert!(all.iter().sum::<u64>() < 30_000);
        patience.progress();
        assert_eq!(waits(&mut patience, BROKEN), all);
    }

    #[test]
    fn a_server_that_publishes_nothing_yet_delays_nobody_for_long() {
        let mut patience = RetryBudget::default();
        assert_eq!(
            waits(&mut patience, FailedRequest::Unavailable),
            [500, 1000]
        );
        assert_eq!(patience.next_wait(BROKEN), Some(WAITS[2]));
        assert_eq!(patience.next_wait(FailedRequest::Unavailable), None);
        assert_eq!(
            RetryBudget::default().next_wait(FailedRequest::ForGood),
            None
        );
    }

    #[test]
    fn the_reader_waits_as_long_as_the_server_asks_for_but_not_for_ever() {
        let asks = |seconds| {
            let again = Some(Duration::from_secs(seconds));
            waits(
                &mut RetryBudget::default(),
                FailedRequest::Passing { again },
            )
        };
        assert_eq!(asks(5), [5000, 5000, 5000, 5000, 8000]);
        assert!(asks(30).is_empty());
        assert!(asks(u64::MAX).is_empty());
    }

    #[test]
    fn a_server_that_sends_a_byte_now_and_then_is_given_up() {
        let mut patience = RetryBudget::default();
        for _ in 0..19 {
            assert!(patience.keeps_pace(1, Duration::from_secs(30)));
        }
        assert!(!patience.keeps_pace(1, Duration::from_secs(30)));
        // A slow line keeps pace: 16 MiB come in time.
        let mut patience = RetryBudget::default();
        for _ in 0..100 {
            assert!(patience.keeps_pace(LEAST_BYTES, Duration::from_secs(599)));
        }
    }
}
