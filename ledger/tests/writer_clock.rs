//! A time that the clock leapt to is never recorded.

use crate::network::*;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::Arc;
use std::time::Duration;
use zk0_ledger::clock::{ClockError, TOLERANCE_MS};
use zk0_ledger::replay;
use zk0_ledger::replay::Verdict;
use zk0_ledger::{Ledger, LedgerError};

/// A clock that only moves on. The test moves it by hand.
#[derive(Clone, Default)]
struct Passed(Arc<AtomicU64>);

impl Passed {
    fn pass(&self, ms: u64) {
        self.0.fetch_add(ms, Ordering::SeqCst);
    }

    fn reader(&self) -> impl Fn() -> Duration + Send + Sync + 'static {
        let passed = self.0.clone();
        move || Duration::from_millis(passed.load(Ordering::SeqCst))
    }
}

const HOUR: u64 = 3_600_000;

#[test]
fn an_entry_from_the_future_is_refused_and_the_log_goes_on() {
    let dir = tempfile::tempdir().unwrap();
    let (mut ledger, _) = Ledger::create(dir.path(), genesis(), log_key(), T0).unwrap();
    let passed = Passed::default();
    passed.pass(17 * HOUR);
    ledger.watch_clock(T0, passed.reader()).unwrap();
    ledger.append(T0 + TOLERANCE_MS, enrolled(0)).unwrap();
    let before = (ledger.size(), ledger.checkpoint().to_vec());
    for leap in [TOLERANCE_MS + 1, HOUR, u64::MAX - T0] {
        match ledger.append_all(T0 + leap, vec![enrolled(1), enrolled(2)]) {
            Err(LedgerError::Clock(ClockError::LeaptAhead {
                clock_ms,
                expected_ms: T0,
            })) => assert_eq!(clock_ms, T0 + leap),
            other => panic!("{other:?}"),
        }
    }
    assert_eq!(before, (ledger.size(), ledger.checkpoint().to_vec()));
    // The clock is right again, slightly behind the last entry. The entry gets the time of the one before.
    ledger.append(T0 + 5, enrolled(1)).unwrap();
    assert_eq!(ledger.state().time_ms(), T0 + TOLERANCE_MS);
    // The ledger records time that has really passed.
    passed.pass(HOUR);
    ledger.append(T0 + HOUR, enrolled(2)).unwrap();
    drop(ledger);
    let report = replay(dir.path(), None, &mut ());
    assert_eq!((report.verdict, report.entries), (Verdict::Verified, 4));
}

#[test]
fn a_clock_far_behind_the_last_entry_is_refused_at_once() {
    let dir = tempfile::tempdir().unwrap();
    let (mut ledger, _) = Ledger::create(dir.path(), genesis(), log_key(), T0).unwrap();
    ledger.append(T0 + HOUR, enrolled(0)).unwrap();
    let mut watch = |clock_ms| ledger.watch_clock(clock_ms, Passed::default().reader());
    for clock_ms in [0, T0, T0 + HOUR - TOLERANCE_MS - 1] {
        match watch(clock_ms) {
            Err(LedgerError::Clock(error @ ClockError::Behind { .. })) => {
                let last_ms = T0 + HOUR;
                assert_eq!(error, ClockError::Behind { clock_ms, last_ms });
                assert!(error.to_string().contains("before the last entry"));
            }
            other => panic!("{other:?}"),
        }
    }
    watch(T0 + HOUR - TOLERANCE_MS).unwrap();
    ledger
        .append(T0 + HOUR - TOLERANCE_MS, enrolled(1))
        .unwrap();
    assert_eq!(ledger.state().time_ms(), T0 + HOUR);
}
