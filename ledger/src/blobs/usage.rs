//! Counts a store's requests and answers, for monitoring.

use super::error::BlobError;
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};
use zk0_circuits::Digest;

/// What a store can be asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StoreOperation {
    /// To store a blob.
    Put,
    /// To give a blob.
    Get,
    /// To name a blob's size.
    Size,
    /// To remove a blob.
    Remove,
    /// To list the blobs.
    List,
}

impl StoreOperation {
    /// All of them.
    pub const ALL: [Self; 5] = [Self::Put, Self::Get, Self::Size, Self::Remove, Self::List];

    /// Its name in one word.
    pub fn name(self) -> &'static str {
        match self {
            Self::Put => "put",
            Self::Get => "get",
            Self::Size => "size",
            Self::Remove => "remove",
            Self::List => "list",
        }
    }
}

/// Counts of one operation. A blob that moves in parts counts once.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RequestCount {
    /// It did what it was asked for.
    pub done: u64,
    /// It failed, and trying again did not help.
    pub failed: u64,
    /// It had something else, or nothing, under the blob's name.
    pub altered: u64,
    /// Bytes of the blobs that were stored or read.
    pub bytes: u64,
    /// The time of all requests.
    pub time: Duration,
}

/// What a store was asked for since the process began.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Usage {
    counts: [RequestCount; StoreOperation::ALL.len()],
    /// Since when it has failed without an answer.
    failing: Option<Instant>,
}

impl Usage {
    /// How often the store was asked for this.
    pub fn of(&self, operation: StoreOperation) -> RequestCount {
        self.counts[operation as usize]
    }

    /// How long the store has failed; `None` if its last answer was good.
    pub fn failing(&self) -> Option<Duration> {
        self.failing.map(|since| since.elapsed())
    }
}

/// How many blobs a place holds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Amount {
    /// Their number.
    pub blobs: u64,
    /// Their bytes in all.
    pub bytes: u64,
}

impl Amount {
    pub(super) fn of(blobs: &[(Digest, u64)]) -> Self {
        Self {
            blobs: blobs.len() as u64,
            bytes: blobs.iter().map(|(_, size)| size).sum(),
        }
    }
}

#[derive(Debug, Default)]
pub(super) struct UsageCounter(Mutex<Usage>);

impl UsageCounter {
    pub(super) fn now(&self) -> Usage {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Does `work`, which asks the store, and counts it, with the `bytes` of a blob that it moved.
    pub(super) fn count<T>(
        &self,
        operation: StoreOperation,
        work: impl FnOnce() -> Result<T, BlobError>,
        bytes: impl FnOnce(&T) -> u64,
    ) -> Result<T, BlobError> {
        let begun = Instant::now();
        let done = work();
        let mut usage = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let count = &mut usage.counts[operation as usize];
        count.time = count.time.saturating_add(begun.elapsed());
        let failing = match &done {
            Ok(moved) => {
                count.done += 1;
                count.bytes = count.bytes.saturating_add(bytes(moved));
                false
            }
            Err(BlobError::Store(_)) => {
                count.failed += 1;
                true
            }
            Err(BlobError::Altered { .. }) => {
                count.altered += 1;
                false
            }
            // The folder failed, and not the store.
            Err(_) => return done,
        };
        usage.failing = if failing {
            usage.failing.or(Some(Instant::now()))
        } else {
            None
        };
        done
    }
}
