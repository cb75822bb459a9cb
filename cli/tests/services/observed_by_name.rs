//! The page of the metrics names all of them, and what is made for Prometheus and Grafana uses no others.

use crate::harness::root;
use serde_json::Value;
use std::collections::BTreeSet;
use std::fs;
use zk0::audit::watch_metrics::WatchMetrics;
use zk0_aggregator::observe::metrics::Metrics;
use zk0_aggregator::publish::witness_metrics::WitnessMetrics;
use zk0_node::observe::NodeMetrics;
use zk0_prover::service::ProverMetrics;

const RULES: &str = "packaging/prometheus/zk0.rules.yml";
const DASHBOARD: &str = "packaging/grafana/zk0.json";

/// The metrics of all services.
fn declared() -> BTreeSet<String> {
    let all = [
        Metrics::default().names().to_vec(),
        WitnessMetrics::default()
            .observed()
            .registry
            .names()
            .to_vec(),
        NodeMetrics::default().observed().registry.names().to_vec(),
        ProverMetrics::default()
            .observed()
            .registry
            .names()
            .to_vec(),
        WatchMetrics::default().observed().registry.names().to_vec(),
    ];
    all.concat().into_iter().collect()
}

fn file(path: &str) -> String {
    fs::read_to_string(root().join(path)).unwrap()
}

/// The metrics that queries name.
fn named(text: &str) -> BTreeSet<&str> {
    let words = text.split(|sign: char| !sign.is_ascii_alphanumeric() && sign != '_');
    words.filter(|word| word.starts_with("zk0_")).collect()
}

/// Checks that the queries of a file name metrics, and only those that there are.
#[track_caller]
fn names_what_there_is(path: &str, queries: &str) {
    let (named, declared) = (named(queries), declared());
    assert!(named.len() > 8, "{path} names {named:?}");
    let is_declared = |name: &&str| {
        let of_histogram = ["_bucket", "_sum", "_count"];
        let whole = of_histogram
            .iter()
            .filter_map(|part| name.strip_suffix(part))
            .any(|whole| declared.contains(whole));
        whole || declared.contains(*name)
    };
    let unknown: Vec<_> = named.iter().filter(|name| !is_declared(name)).collect();
    assert!(unknown.is_empty(), "{path}: no service has {unknown:?}");
}

#[test]
fn the_page_names_every_metric_and_no_other() {
    let page = file("docs/services.md");
    let declared = declared();
    assert!(declared.len() > 40, "{declared:?}");
    for name in &declared {
        let written = [format!("`{name}`"), format!("`{name}{{")];
        let found = written.iter().any(|name| page.contains(name));
        assert!(found, "docs/services.md does not have {name}");
    }
    names_what_there_is("docs/services.md", &page);
}

#[test]
fn the_rules_of_prometheus_name_metrics_that_there_are() {
    let rules = file(RULES);
    names_what_there_is(RULES, &rules);
    // Nothing here reads YAML, so the rules keep to a few forms of lines that are valid.
    let (mut alerts, mut queries) = (0, 0);
    for line in rules.lines().filter(|line| !line.starts_with('#')) {
        alerts += usize::from(line.starts_with("      - alert: "));
        queries += usize::from(line.starts_with("        expr: "));
        let forms = [
            "groups:",
            "  - name: ",
            "    rules:",
            "      - alert: ",
            "        expr: ",
            "        for: ",
            "        annotations:",
            "          summary: ",
        ];
        let form = forms.iter().find(|form| line.starts_with(*form));
        let form = form.unwrap_or_else(|| panic!("{RULES} has a line of another form: {line}"));
        let value = &line[form.len()..];
        let is_plain = value.chars().all(|sign| sign.is_ascii_alphanumeric());
        let inner = value
            .strip_prefix('\'')
            .and_then(|rest| rest.strip_suffix('\''));
        let is_quoted = inner.is_some_and(|inner| !inner.is_empty() && !inner.contains('\''));
        assert!(is_plain || is_quoted, "{line}");
    }
    assert!(alerts > 8 && alerts == queries, "{alerts} {queries}");
}

#[test]
fn the_dashboard_of_grafana_names_metrics_that_there_are() {
    let dashboard: Value = serde_json::from_str(&file(DASHBOARD)).unwrap();
    let mut queries = String::new();
    let mut ids = BTreeSet::new();
    for panel in dashboard["panels"].as_array().unwrap() {
        assert!(ids.insert(panel["id"].as_u64().unwrap()), "{panel}");
        for target in panel["targets"].as_array().unwrap() {
            queries += target["expr"].as_str().unwrap();
            queries += "\n";
        }
    }
    names_what_there_is(DASHBOARD, &queries);
}
