//! Waits for events, not for time.

use std::fmt::Display;
use std::thread::sleep;
use std::time::{Duration, Instant};

/// Long, so that no test depends on the machine's speed.
const LIMIT: Duration = Duration::from_secs(120);

/// Time between two looks.
const EVERY: Duration = Duration::from_millis(5);

/// Met if `true` or `Some`.
pub trait Condition {
    /// The test's value.
    type Value;
    /// The value, if met.
    fn met(self) -> Option<Self::Value>;
}

impl Condition for bool {
    type Value = ();

    fn met(self) -> Option<()> {
        self.then_some(())
    }
}

impl<T> Condition for Option<T> {
    type Value = T;

    fn met(self) -> Option<T> {
        self
    }
}

/// Waits for `condition`. Returns its value, or panics with `what`, the expected event, after two minutes.
#[track_caller]
pub fn until<C: Condition>(what: impl Display, mut condition: impl FnMut() -> C) -> C::Value {
    let begun = Instant::now();
    loop {
        if let Some(value) = condition().met() {
            return value;
        }
        assert!(begun.elapsed() < LIMIT, "not within {LIMIT:?}: {what}");
        sleep(EVERY);
    }
}

/// [`until`] for tests with a runtime.
#[cfg(feature = "until_async")]
pub async fn until_async<C: Condition>(
    what: impl Display,
    mut condition: impl AsyncFnMut() -> C,
) -> C::Value {
    let begun = Instant::now();
    loop {
        if let Some(value) = condition().await.met() {
            return value;
        }
        assert!(begun.elapsed() < LIMIT, "not within {LIMIT:?}: {what}");
        tokio::time::sleep(EVERY).await;
    }
}
