//! What a service finds wrong with itself; `zk0_trouble` and `/health` show it.

use crate::metrics::registry::MetricRegistry;
use prometheus_client::metrics::family::Family;
use prometheus_client::metrics::gauge::Gauge;
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// A service's troubles by kind. Clones share them.
#[derive(Clone)]
pub struct ServiceTroubles {
    in_force: Arc<Mutex<BTreeMap<&'static str, String>>>,
    metric: Family<[(&'static str, &'static str); 1], Gauge>,
}

impl ServiceTroubles {
    /// No trouble yet, of these kinds.
    pub fn registered(registry: &mut MetricRegistry, kinds: &[&'static str]) -> Self {
        let metric = Family::default();
        registry.register(
            "trouble",
            "1 for each kind of trouble that the service has",
            metric.clone(),
        );
        let new = Self {
            in_force: Arc::default(),
            metric,
        };
        for &kind in kinds {
            new.clear(kind);
        }
        new
    }

    /// Reports trouble of this kind.
    pub fn raise(&self, kind: &'static str, sentence: impl Into<String>) {
        self.in_force().insert(kind, sentence.into());
        self.metric.get_or_create(&[("kind", kind)]).set(1);
    }

    /// Ends trouble of this kind.
    pub fn clear(&self, kind: &'static str) {
        self.in_force().remove(kind);
        self.metric.get_or_create(&[("kind", kind)]).set(0);
    }

    /// A sentence for each trouble.
    pub fn sentences(&self) -> Vec<String> {
        self.in_force().values().cloned().collect()
    }

    fn in_force(&self) -> MutexGuard<'_, BTreeMap<&'static str, String>> {
        // The holders do not panic.
        self.in_force.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_trouble_is_shown_until_it_is_over() {
        let mut registry = MetricRegistry::default();
        let troubles = ServiceTroubles::registered(&mut registry, &["disk", "peer"]);
        let shows = |line: &str| registry.text().unwrap().contains(line);
        assert!(shows("zk0_trouble{kind=\"disk\"} 0\n") && shows("zk0_trouble{kind=\"peer\"} 0\n"));
        troubles.raise("peer", "the peer is away");
        assert!(shows("zk0_trouble{kind=\"peer\"} 1\n"));
        assert_eq!(troubles.sentences(), ["the peer is away"]);
        troubles.clear("peer");
        assert!(shows("zk0_trouble{kind=\"peer\"} 0\n"));
        assert!(troubles.sentences().is_empty());
    }
}
