//! A bounded queue in front of work of which little runs at once. When it is full, newcomers have to come again. Otherwise they would wait
//! for hours, and hold memory.

use std::sync::Arc;
use tokio::sync::{OwnedSemaphorePermit, Semaphore};

#[derive(Clone)]
pub(crate) struct WorkQueue {
    places: Arc<Semaphore>,
    waiting: Arc<Semaphore>,
}

/// A place, until dropped. Give it to the work itself: the caller may leave earlier.
pub(crate) struct WorkPermit {
    _permit: OwnedSemaphorePermit,
}

impl WorkQueue {
    pub fn new(places: usize, waiting: usize) -> Self {
        Self {
            places: Arc::new(Semaphore::new(places)),
            waiting: Arc::new(Semaphore::new(waiting)),
        }
    }

    /// Waits for a place. `None` at once if too many wait already.
    pub async fn place(&self) -> Option<WorkPermit> {
        let places = || self.places.clone();
        let permit = match places().try_acquire_owned() {
            Ok(permit) => permit,
            Err(_) => {
                let _waits = self.waiting.try_acquire().ok()?;
                places().acquire_owned().await.ok()?
            }
        };
        Some(WorkPermit { _permit: permit })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;
    use tokio::time::timeout;

    #[tokio::test]
    async fn who_comes_when_the_line_is_full_is_sent_away() {
        let line = WorkQueue::new(1, 1);
        let first = line.place().await.unwrap();
        let second = tokio::spawn({
            let line = line.clone();
            async move { line.place().await.is_some() }
        });
        tokio::task::yield_now().await;
        assert!(line.place().await.is_none());
        drop(first);
        assert!(second.await.unwrap());
        assert!(line.place().await.is_some());
    }

    #[tokio::test]
    async fn who_leaves_the_line_makes_room_in_it() {
        let line = WorkQueue::new(1, 1);
        let _first = line.place().await.unwrap();
        for _ in 0..3 {
            let waiting = timeout(Duration::from_millis(10), line.place()).await;
            assert!(waiting.is_err(), "it did not wait");
        }
    }
}
