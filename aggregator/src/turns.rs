//! One turn at a time for each key, independent of other keys.

use std::collections::HashMap;
use std::hash::Hash;
use std::sync::{Arc, Mutex, PoisonError, Weak};
use tokio::sync::{Mutex as Turn, OwnedMutexGuard};

/// How many are remembered before those without a turn are forgotten.
const REMEMBERED: usize = 4096;

#[derive(Clone)]
pub(crate) struct KeyedTurns<K>(Arc<Mutex<HashMap<K, Weak<Turn<()>>>>>);

impl<K> Default for KeyedTurns<K> {
    fn default() -> Self {
        Self(Arc::default())
    }
}

impl<K: Eq + Hash> KeyedTurns<K> {
    /// Waits for the turn of `key`, which lasts until the guard is dropped.
    pub async fn take(&self, key: K) -> OwnedMutexGuard<()> {
        self.of(key).lock_owned().await
    }

    fn of(&self, key: K) -> Arc<Turn<()>> {
        // A panic elsewhere leaves the map whole.
        let mut turns = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if turns.len() >= REMEMBERED {
            turns.retain(|_, turn| turn.strong_count() > 0);
        }
        let turn = turns.entry(key).or_default();
        turn.upgrade().unwrap_or_else(|| {
            let new = Arc::new(Turn::new(()));
            *turn = Arc::downgrade(&new);
            new
        })
    }
}
