//! How long a node waits before it asks again: longer with each attempt, and at least as long as the aggregator tells. The waits are
//! random, so that nodes do not all ask at once.

use crate::progress;
use std::error::Error as _;
use std::time::Duration;
use tokio::time::{sleep, Instant};
use tonic::{Code, Status};
use zk0_protocol::growing_waits::GrowingWaits;
use zk0_protocol::rpc::federation::turned_down::Remedy;
use zk0_protocol::rpc::federation::TurnedDown;

const WAITS: GrowingWaits = GrowingWaits {
    first: Duration::from_secs(1),
    longest: Duration::from_secs(60),
};

/// The longest wait that an aggregator can ask for.
const MOST_TOLD: Duration = Duration::from_secs(60);

const PHASE: &str = "waiting for the aggregator";

/// The waits until an answer, or until a connection transfers bytes again.
#[derive(Default)]
pub(crate) struct Waits {
    attempt: u32,
    since: Option<Instant>,
    /// The last failure in the log.
    logged: Option<Code>,
}

impl Waits {
    /// Waits after this failure. Returns it if it does not pass, or if all waits would take longer than `limit`.
    pub async fn again(&mut self, failure: Status, limit: Option<Duration>) -> Result<(), Status> {
        let waited = self.since.get_or_insert_with(Instant::now).elapsed();
        let Some(pause) = self.next(&failure, waited, limit) else {
            return Err(failure);
        };
        if self.logged.replace(failure.code()) != Some(failure.code()) {
            tracing::warn!(
                "{}; the node asks again, after longer and longer waits of up to a minute",
                why(&failure)
            );
        }
        let (waited_ms, pause_ms) = (waited.as_millis() as u64, pause.as_millis() as u64);
        progress::report(PHASE, waited_ms, waited_ms + pause_ms, pause_ms);
        sleep(pause).await;
        Ok(())
    }

    /// Waits a moment after something has ended as it should.
    pub async fn shortly(&mut self) {
        let pause = WAITS.wait(self.attempt, random(), Duration::ZERO);
        self.attempt = self.attempt.saturating_add(1);
        sleep(pause).await;
    }

    /// Makes the next wait short, after an answer.
    pub fn end(&mut self) {
        if let Some(since) = self.since {
            progress::report(PHASE, 1, 1, 0);
            let waited = since.elapsed().as_secs();
            tracing::info!("the aggregator answers again; the node has waited for {waited} s");
        }
        *self = Self::default();
    }

    /// The next wait, after `waited` so far; `None` if the node gives up.
    fn next(
        &mut self,
        failure: &Status,
        waited: Duration,
        limit: Option<Duration>,
    ) -> Option<Duration> {
        let pause = WAITS.wait(self.attempt, random(), told(failure));
        let too_long = limit.is_some_and(|limit| waited + pause > limit);
        if too_long || !may_pass(failure) {
            return None;
        }
        self.attempt = self.attempt.saturating_add(1);
        Some(pause)
    }
}

/// Without a random number, the wait is the longest.
fn random() -> u32 {
    getrandom::u32().unwrap_or(u32::MAX)
}

/// Whether the same request may be granted later. The aggregator tells that when it turns a request down. Other failures come from the
/// network.
pub(crate) fn may_pass(failure: &Status) -> bool {
    match TurnedDown::of(failure).remedy() {
        Remedy::AskAgain => true,
        Remedy::Never | Remedy::NextRound => false,
        Remedy::Unspecified => match failure.code() {
            Code::Unavailable
            | Code::ResourceExhausted
            | Code::Internal
            | Code::DeadlineExceeded
            | Code::Aborted => true,
            // An answer has no source.
            Code::Unknown | Code::Cancelled => failure.source().is_some(),
            _ => false,
        },
    }
}

fn told(failure: &Status) -> Duration {
    Duration::from_millis(TurnedDown::of(failure).after_ms).min(MOST_TOLD)
}

pub(crate) fn why(failure: &Status) -> String {
    let message = failure.message();
    match failure.source() {
        None if !message.is_empty() => format!("the aggregator cannot do it now: {message}"),
        Some(_) if !message.is_empty() => format!("the aggregator does not answer ({message})"),
        _ => "the aggregator does not answer".into(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const NOTHING: Duration = Duration::ZERO;

    #[test]
    fn waits_grow_to_a_minute_and_are_drawn_between_half_and_whole() {
        let bounds = |attempt| {
            [0, u32::MAX].map(|random| WAITS.wait(attempt, random, NOTHING).as_millis() as u64)
        };
        assert_eq!(bounds(0), [500, 1000]);
        assert_eq!(bounds(1), [750, 1500]);
        assert_eq!(bounds(2), [1125, 2250]);
        for attempt in [11, 1000, u32::MAX] {
            assert_eq!(bounds(attempt), [30_000, 60_000]);
        }
        let middle = WAITS.wait(0, u32::MAX / 2, NOTHING);
        assert!((749..=750).contains(&middle.as_millis()), "{middle:?}");
    }

    #[test]
    fn a_node_asks_no_sooner_than_it_was_told() {
        let told = Duration::from_secs(2);
        assert_eq!(WAITS.wait(0, 0, told), told);
        assert_eq!(WAITS.wait(0, u32::MAX, told), 2 * told);
        // Later waits are longer than that.
        assert_eq!(WAITS.wait(20, 0, told), Duration::from_secs(30));
        let details = |after_ms| TurnedDown {
            after_ms,
            ..TurnedDown::default()
        };
        let wanted = |after_ms| super::told(&details(after_ms).status(Code::Unavailable, ""));
        assert_eq!(wanted(7000), Duration::from_secs(7));
        assert_eq!(wanted(u64::MAX), MOST_TOLD);
    }

    #[test]
    fn the_aggregator_s_advice_decides_and_the_code_where_there_is_none() {
        let advised = |code, remedy: Remedy| {
            let details = TurnedDown {
                remedy: remedy.into(),
                ..TurnedDown::default()
            };
            may_pass(&details.status(code, ""))
        };
        for code in [
            Code::Unavailable,
            Code::ResourceExhausted,
            Code::Internal,
            Code::NotFound,
        ] {
            assert!(advised(code, Remedy::AskAgain), "{code:?}");
            assert!(!advised(code, Remedy::Never), "{code:?}");
            assert!(!advised(code, Remedy::NextRound), "{code:?}");
            let passes = code != Code::NotFound;
            assert_eq!(may_pass(&Status::new(code, "")), passes, "{code:?}");
        }
        let broken = std::io::Error::other("broken pipe");
        assert!(may_pass(&Status::from_error(broken.into())));
        assert!(!may_pass(&Status::unknown("")));
    }

    #[test]
    fn waits_have_an_end_only_where_there_is_a_limit() {
        let away = Status::unavailable("away");
        let limit = Some(Duration::from_secs(10));
        let (mut waits, mut waited) = (Waits::default(), Duration::ZERO);
        while let Some(pause) = waits.next(&away, waited, limit) {
            waited += pause;
        }
        assert!(waited > WAITS.first && Some(waited) <= limit, "{waited:?}");
        let (mut waits, mut waited) = (Waits::default(), Duration::ZERO);
        for _ in 0..1000 {
            waited += waits.next(&away, waited, None).unwrap();
        }
        let refused = Status::permission_denied("");
        assert_eq!(waits.next(&refused, waited, None), None);
        // An answer ends the waits.
        waits.end();
        assert!(waits.next(&away, NOTHING, limit).unwrap() <= WAITS.first);
    }
}
