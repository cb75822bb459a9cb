//! What the operator of a proving service sees.

use super::{bounded_service, comes, refusal};
use std::sync::Arc;
use zk0_prover::rpc::progress::Phase;
use zk0_prover::service::ProverMetrics;
use zk0_testkit::until_async;

fn shows(metrics: &ProverMetrics, line: &str) -> bool {
    let text = metrics.observed().registry.text().unwrap();
    text.lines().any(|shown| shown == line)
}

/// How many requests have ended like this.
fn ended_so(metrics: &ProverMetrics, how: &str) -> u64 {
    let begin = format!("zk0_prover_requests_total{{ended=\"{how}\"}} ");
    let text = metrics.observed().registry.text().unwrap();
    let mut shown = text.lines().filter_map(|line| line.strip_prefix(&begin));
    shown.next().map_or(0, |count| count.parse().unwrap())
}

async fn shows_soon(metrics: &ProverMetrics, line: &str) {
    until_async(format!("{line} is shown"), async || shows(metrics, line)).await;
}

fn wrong(metrics: &ProverMetrics) -> Vec<String> {
    metrics.observed().troubles.sentences()
}

#[tokio::test]
async fn the_queue_and_the_ends_of_requests_are_counted() {
    let mut metrics = ProverMetrics::default();
    assert_eq!(wrong(&metrics), ["the prover is starting"]);
    let service = bounded_service(1, 0, |service| {
        metrics = service.metrics().clone();
        service
    });
    let service = Arc::new(service.await);
    let first = service.asking_until("first", Phase::Proving).await;
    // The service proves, so it has started.
    assert!(wrong(&metrics).is_empty());
    let second = service.asking_until("second", Phase::Queued).await;
    assert!(shows(&metrics, "zk0_prover_busy 1"));
    assert!(shows(&metrics, "zk0_prover_claims_waiting 1"));
    // The second one may have asked before there was room.
    let before = ended_so(&metrics, "not_taken");
    refusal(service.prove("third").await);
    assert!(ended_so(&metrics, "not_taken") > before);
    let ended = |how: &str| format!("zk0_prover_requests_total{{ended=\"{how}\"}} 1");
    second.abort();
    shows_soon(&metrics, &ended("gone")).await;
    assert!(shows(&metrics, "zk0_prover_claims_waiting 0"));
    service.allowed.add_permits(1);
    comes(first).await;
    shows_soon(&metrics, &ended("proven")).await;
    shows_soon(&metrics, "zk0_prover_busy 0").await;
    refusal(service.prove("false").await);
    shows_soon(&metrics, &ended("refused")).await;
}

#[tokio::test]
async fn a_proof_that_fails_is_trouble_until_one_does_not() {
    let mut metrics = ProverMetrics::default();
    let service = bounded_service(1, 2, |service| {
        metrics = service.metrics().clone();
        service
    });
    let service = service.await;
    refusal(service.prove("fail").await);
    assert_eq!(wrong(&metrics), ["proving failed: out of luck"]);
    assert!(shows(&metrics, "zk0_trouble{kind=\"proof\"} 1"));
    service.prove("claim").await.unwrap();
    assert!(wrong(&metrics).is_empty());
}
