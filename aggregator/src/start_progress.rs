//! How far the start of an aggregator is, for its operator and for those who ask.

use futures_core::future::BoxFuture;
use std::fmt;
use std::future;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::Arc;
use zk0_service::metrics::endpoint::Observed;

/// How many entries of the ledger are verified at the start, and how many there are; then, whether a witness is waited for. Clones share that.
#[derive(Clone, Debug, Default)]
pub struct StartProgress {
    verified: Arc<AtomicU64>,
    whole: Arc<AtomicU64>,
    waits: Arc<AtomicBool>,
}

impl StartProgress {
    /// So many entries of `whole` are verified.
    pub fn note(&self, verified: u64, whole: u64) {
        self.whole.store(whole, Ordering::Relaxed);
        self.verified.store(verified, Ordering::Relaxed);
    }

    /// All entries are verified, and nothing is signed before a witness answers.
    pub fn waits_for_witness(&self) {
        self.waits.store(true, Ordering::Relaxed);
    }
}

impl fmt::Display for StartProgress {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.waits.load(Ordering::Relaxed) {
            return f.write_str("the aggregator starts, and waits for an answer of a witness");
        }
        let of = |count: &AtomicU64| count.load(Ordering::Relaxed);
        let (verified, whole) = (of(&self.verified), of(&self.whole));
        write!(
            f,
            "the aggregator starts, and {verified} of {whole} entries are verified"
        )
    }
}

impl Observed for StartProgress {
    fn metrics_text(&self) -> BoxFuture<'_, Result<String, String>> {
        Box::pin(future::ready(Err(self.to_string())))
    }

    fn what_is_wrong(&self) -> Vec<String> {
        vec![self.to_string()]
    }
}
