//! How far the start of an aggregator is.

use std::fmt;
use std::sync::atomic::{AtomicU64, Ordering};

/// How many entries of the ledger are verified at the start, and how many there are.
#[derive(Debug, Default)]
pub struct StartProgress {
    verified: AtomicU64,
    whole: AtomicU64,
}

impl StartProgress {
    /// So many entries of `whole` are verified.
    pub fn note(&self, verified: u64, whole: u64) {
        self.whole.store(whole, Ordering::Relaxed);
        self.verified.store(verified, Ordering::Relaxed);
    }
}

impl fmt::Display for StartProgress {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let of = |count: &AtomicU64| count.load(Ordering::Relaxed);
        let (verified, whole) = (of(&self.verified), of(&self.whole));
        write!(f, "{verified} of {whole} entries are verified")
    }
}
