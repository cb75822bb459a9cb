//! How far the start of an aggregator is, for its operator and for those who ask.

use futures_core::future::BoxFuture;
use std::fmt;
use std::future;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::Arc;
use zk0_service::metrics::endpoint::Observed;

/// How many entries of the ledger are verified at the start, and how many there are. Clones share that.
#[derive(Clone, Debug, Default)]
pub struct StartProgress {
    verified: Arc<AtomicU64>,
    whole: Arc<AtomicU64>,
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
