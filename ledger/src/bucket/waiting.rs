//! How long to wait for a store. The ledger's threads read and write blobs, and wait here for a small runtime.

use object_store::{BackoffConfig, RetryConfig};
use std::future::Future;
use std::io;
use std::panic::resume_unwind;
use std::thread;
use std::time::Duration;
use tokio::runtime::{Builder, Runtime};

/// A request that moves less than a part in this time is given up, and tried again. Copies and uploads in parts have all of the time,
/// because the store puts parts together at the end of an upload.
const LONGEST_REQUEST: Duration = Duration::from_secs(30);

/// Time limit for connecting.
const CONNECT: Duration = Duration::from_secs(5);

/// The longest wait between two tries.
const LONGEST_BACKOFF: Duration = Duration::from_secs(5);

/// Enough tries that [`RetryPeriod::retries`] ends by its time.
const TRIES: usize = 100;

/// How long to retry a request that may succeed later.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RetryPeriod(pub Duration);

impl RetryPeriod {
    pub(super) fn request(self) -> Duration {
        self.0.min(LONGEST_REQUEST)
    }

    pub(super) fn connect(self) -> Duration {
        self.0.min(CONNECT)
    }

    /// The tries after the first.
    pub(super) fn retries(self) -> RetryConfig {
        RetryConfig {
            backoff: BackoffConfig {
                init_backoff: Duration::from_millis(100),
                max_backoff: LONGEST_BACKOFF,
                base: 2.0,
            },
            max_retries: TRIES,
            retry_timeout: self.0,
        }
    }
}

/// The threads that talk to the store.
#[derive(Debug)]
pub(super) struct StoreRuntime(Option<Runtime>);

impl StoreRuntime {
    pub(super) fn new() -> io::Result<Self> {
        let mut builder = Builder::new_multi_thread();
        let builder = builder.worker_threads(2).thread_name("blob-store");
        Ok(Self(Some(builder.enable_all().build()?)))
    }

    /// Waits for `work` on a thread of its own, because a thread of another runtime must not wait for this one.
    pub(super) fn wait_for<T: Send>(&self, work: impl Future<Output = T> + Send) -> T {
        let runtime = self
            .0
            .as_ref()
            .expect("it is taken only when this is dropped");
        thread::scope(|scope| {
            let waiting = scope.spawn(|| runtime.block_on(work));
            waiting.join().unwrap_or_else(|panic| resume_unwind(panic))
        })
    }
}

impl Drop for StoreRuntime {
    fn drop(&mut self) {
        // Dropping a runtime waits for its threads, which a thread of another runtime must not do.
        if let Some(runtime) = self.0.take() {
            runtime.shutdown_background();
        }
    }
}
