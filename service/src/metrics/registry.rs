//! The metrics of one service. Each begins with `zk0_`, and `docs/services.md` lists all of them.

use crate::metrics::process;
use prometheus_client::encoding::text::encode;
use prometheus_client::metrics::family::Family;
use prometheus_client::metrics::gauge::Gauge;
use prometheus_client::metrics::MetricType;
use prometheus_client::registry::{Metric, Registry};
use std::fmt;
use std::time::{SystemTime, UNIX_EPOCH};

const PREFIX: &str = "zk0";

/// Metrics, among them every service's: release and process.
pub struct MetricRegistry {
    registry: Registry,
    names: Vec<String>,
    memory: Gauge,
    open_files: Gauge,
}

impl Default for MetricRegistry {
    fn default() -> Self {
        let mut new = Self {
            registry: Registry::with_prefix(PREFIX),
            names: Vec::new(),
            memory: Gauge::default(),
            open_files: Gauge::default(),
        };
        let build = Family::<[(&str, &str); 1], Gauge>::default();
        new.register("build_info", "1, with the release of zk0", build.clone());
        build
            .get_or_create(&[("version", env!("CARGO_PKG_VERSION"))])
            .set(1);
        let (memory, open_files) = (new.memory.clone(), new.open_files.clone());
        new.register("memory_bytes", "Memory that the process holds", memory);
        new.register(
            "open_files",
            "Files and connections that the process has open",
            open_files,
        );
        new
    }
}

impl MetricRegistry {
    /// Declares a metric; `name` lacks the prefix and a counter's `_total`.
    pub fn register(&mut self, name: &str, help: &str, metric: impl Metric) {
        let is_counter = metric.metric_type() == MetricType::Counter;
        let ending = if is_counter { "_total" } else { "" };
        self.names.push(format!("{PREFIX}_{name}{ending}"));
        self.registry.register(name, help, metric);
    }

    /// All metrics' whole names, also without a value yet.
    pub fn names(&self) -> &[String] {
        &self.names
    }

    /// All metrics as text.
    pub fn text(&self) -> Result<String, fmt::Error> {
        self.memory.set(gauged(process::memory()));
        self.open_files.set(gauged(process::open_files()));
        let mut text = String::new();
        encode(&mut text, &self.registry)?;
        Ok(text)
    }
}

/// A gauge's number.
pub fn gauged(number: u64) -> i64 {
    i64::try_from(number).unwrap_or(i64::MAX)
}

/// The time in Unix seconds.
pub fn now_s() -> i64 {
    let since = SystemTime::now().duration_since(UNIX_EPOCH);
    gauged(since.map_or(0, |since| since.as_secs()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use prometheus_client::metrics::counter::Counter;

    #[test]
    fn a_metric_has_its_name_before_it_has_a_value() {
        let mut registry = MetricRegistry::default();
        let events = Family::<[(&str, &str); 1], Counter>::default();
        registry.register("events", "Events", events.clone());
        registry.register("level", "The level", Gauge::<i64>::default());
        let own = ["zk0_build_info", "zk0_memory_bytes", "zk0_open_files"];
        let more = ["zk0_events_total", "zk0_level"];
        assert_eq!(registry.names(), [&own[..], &more].concat());
        assert!(!registry.text().unwrap().contains("zk0_events"));
        events.get_or_create(&[("kind", "one")]).inc();
        let text = registry.text().unwrap();
        assert!(
            text.contains("zk0_events_total{kind=\"one\"} 1\n"),
            "{text}"
        );
        assert!(!text.contains("zk0_memory_bytes 0\n"), "{text}");
    }
}
