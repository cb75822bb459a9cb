//! An aggregator whose clock is set forward records nothing by it, until its operator starts it again. A small step back ends nothing.

use std::fmt::{Debug, Display};
use std::sync::Arc;
use zk0_aggregator::round::request_error::RequestError;
use zk0_aggregator::{Aggregator, Config, Polled};
use zk0_circuits::NodeId;
use zk0_testkit::aggregator::*;

fn id(seed: u8) -> NodeId {
    let key = ed25519_dalek::SigningKey::from_bytes(&[seed; 32]);
    NodeId(key.verifying_key().to_bytes())
}

fn leapt<T: Debug, E: Debug + Display>(result: Result<T, E>) {
    let error = result.unwrap_err().to_string();
    assert!(
        error.contains("s ahead. An entry with such a time could not be undone"),
        "{error}"
    );
}

#[test]
fn a_clock_set_forward_opens_no_round_and_ends_none() {
    let dir = tempfile::tempdir().unwrap();
    let clock = Arc::new(ManualClock::at(START_MS));
    let config = Config {
        rounds: None,
        min_nodes: 0,
    };
    let mut aggregator = found(dir.path(), genesis(), clock.clone(), config).unwrap();
    clock.advance(24 * 3_600_000);
    aggregator.enrol(id(1), "one".into()).unwrap();
    let entries = aggregator.state().entries();
    clock.set_forward(365 * 24 * 3_600_000);
    leapt(aggregator.step());
    leapt(aggregator.enrol(id(2), "two".into()));
    assert_eq!(aggregator.state().entries(), entries);
    drop(aggregator);
    // When the operator starts it again with that clock, the aggregator believes the clock.
    let open =
        |clock: ManualClock| Aggregator::open(dir.path(), None, log_key(), Arc::new(clock), config);
    let behind = open(ManualClock::at(START_MS)).map(drop).unwrap_err();
    assert!(
        behind.to_string().contains("before the last entry"),
        "{behind}"
    );
    let now = ManualClock::at(START_MS + 366 * 24 * 3_600_000);
    let mut aggregator = open(now).unwrap();
    aggregator.enrol(id(2), "two".into()).unwrap();
}

#[tokio::test(flavor = "multi_thread")]
async fn a_round_waits_when_the_clock_steps_back_while_its_end_is_computed() {
    let (network, first, second) = open_round().await;
    both_committed(&network, &first, &second).await;
    network.drawn().await;
    let clock = network.clock.clone();
    // The aggregator is held all the time, so that the rounds of the service close nothing meanwhile.
    let close = move |aggregator: &mut Aggregator| {
        let round = aggregator.state().round().unwrap();
        let deadline_ms = round.randomness.as_ref().unwrap().submit_deadline_ms;
        clock.advance(deadline_ms + 1 - aggregator.now_ms());
        let Polled::Run(job) = aggregator.step()? else {
            panic!("the round may close");
        };
        let computed = run_job(job)?.unwrap();
        clock.jump(-1_000);
        let entries = aggregator.state().entries();
        let until_ms = Some(deadline_ms + 1);
        assert_eq!(aggregator.finish(computed)?, Polled::Idle(until_ms));
        assert_eq!(aggregator.state().entries(), entries);
        Ok::<_, RequestError>(())
    };
    network.service().with(close).await.unwrap();
    assert!(network.round(Some(0)).await.closed.is_none());
    network.clock.jump(1_000);
    network.settle().await;
    assert!(network.round(Some(0)).await.closed.is_some());
}
