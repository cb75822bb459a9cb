//! Waiting for what a test expects to happen, and not for time.

use std::fmt::Display;
use std::thread::sleep;
use std::time::{Duration, Instant};

/// No test depends on how fast the machine is.
const LIMIT: Duration = Duration::from_secs(120);

/// How often a condition is looked at.
const EVERY: Duration = Duration::from_millis(5);

/// What a condition gives: `true` or `Some` when it is met.
pub trait Condition {
    /// What the test gets then.
    type Value;
    /// This value, if the condition is met.
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

/// Waits until `condition` is met, and returns its value. Panics with `what`, which says what has to happen, after two minutes.
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

/// Like [`until`], for tests with a runtime.
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
