//! No network is founded, no rule is proposed and no round opens with public samples that are not there or that cannot be used: the
//! result of a round could not be evaluated.

use crate::Test;
use std::sync::Arc;
use zk0_aggregator::round::founding::{Founding, FoundingError};
use zk0_aggregator::round::request_error::RequestError;
use zk0_aggregator::{Aggregator, Config, Polled, RoundStep};
use zk0_ledger::Ledger;
use zk0_protocol::entries::proposal::Action;
use zk0_protocol::rules::closing::public_samples::PublicSamples;
use zk0_protocol::Genesis;
use zk0_testkit::aggregator::operator::proposed;
use zk0_testkit::aggregator::samples::{public_samples, rule_of};
use zk0_testkit::aggregator::*;
use zk0_verifier::blob_digest;

const CONFIG: Config = Config {
    rounds: Some(1),
    min_nodes: 1,
};

fn with_samples(rule: PublicSamples) -> Genesis {
    let mut founded = genesis();
    founded.rules.public_samples = Some(rule);
    founded
}

fn founded(
    dir: &std::path::Path,
    genesis: Genesis,
    samples: Option<&[u8]>,
) -> Result<Ledger, FoundingError> {
    let founding = Founding {
        public_samples: samples.map(<[u8]>::to_vec),
        ..founding(genesis)
    };
    let clock = ManualClock::at(START_MS);
    founding.found(dir, log_key(), &clock, 1 << 20, write_policy)
}

/// An aggregator with one node that has a dataset, so that a round would open.
fn ready(genesis: Genesis, samples: &[u8]) -> (tempfile::TempDir, Aggregator) {
    let dir = tempfile::tempdir().unwrap();
    drop(founded(dir.path(), genesis, Some(samples)).unwrap());
    let clock = Arc::new(ManualClock::at(START_MS));
    let mut aggregator = Aggregator::open(dir.path(), None, log_key(), clock, CONFIG).unwrap();
    let node = SigningNode::new(1);
    aggregator.enrol(node.id(), "the only one".into()).unwrap();
    let registration = node.registration(aggregator.state().network());
    let registration = borsh::to_vec(&registration).unwrap();
    aggregator.register(&registration, &node.list()).unwrap();
    (dir, aggregator)
}

#[test]
fn a_network_is_not_founded_on_samples_that_are_missing_or_others() {
    let samples = public_samples();
    let refused = |rule, samples: Option<&[u8]>| {
        let dir = tempfile::tempdir().unwrap();
        let error = founded(dir.path(), with_samples(rule), samples)
            .err()
            .unwrap();
        assert!(matches!(error, FoundingError::PublicSamples { .. }));
        error.to_string()
    };
    let rule = rule_of(&samples);
    assert!(refused(rule, None).contains("the file is not given"));
    assert!(refused(rule, Some(&samples[8..])).contains("this file has SHA-256"));
    let five = PublicSamples { samples: 5, ..rule };
    assert!(refused(five, Some(&samples)).contains("ends after sample 3; the rules count 5"));
    let noise = [0x55; 64];
    let other = rule_of(&noise);
    assert!(
        refused(other, Some(&noise)).contains("were the samples made for the network's policy?")
    );

    let dir = tempfile::tempdir().unwrap();
    let ledger = founded(dir.path(), with_samples(rule), Some(&samples)).unwrap();
    assert!(ledger.blobs().contains(&rule.blob));
}

#[test]
fn no_round_opens_until_the_samples_are_there() -> Test {
    let samples = public_samples();
    let rule = rule_of(&samples);
    let (_dir, mut aggregator) = ready(with_samples(rule), &samples);
    let path = aggregator.ledger().blobs().path(&rule.blob);
    std::fs::remove_file(&path)?;
    let Polled::Blocked(why) = aggregator.go_on()? else {
        panic!("a round opened");
    };
    assert!(
        why.contains(&format!("there is no blob {}", rule.blob)),
        "{why}"
    );
    std::fs::write(&path, &samples[..samples.len() - 1])?;
    assert!(matches!(aggregator.go_on()?, Polled::Blocked(_)));
    std::fs::write(&path, &samples)?;
    assert_eq!(aggregator.go_on()?, Polled::Did(RoundStep::Open(0)));
    Ok(())
}

#[test]
fn nobody_can_propose_samples_that_the_aggregator_cannot_use() -> Test {
    let samples = public_samples();
    let (_dir, mut aggregator) = ready(with_samples(rule_of(&samples)), &samples);
    let propose = |aggregator: &mut Aggregator, rule: PublicSamples| {
        let mut rules = aggregator.state().rules().clone();
        rules.public_samples = Some(rule);
        let action = Action::ChangeRules(Box::new(rules));
        let body = borsh::to_vec(&proposed(aggregator.state(), action)).unwrap();
        aggregator.tell(&body)
    };
    let fewer = samples[..samples.len() / 3].to_vec();
    let rule = PublicSamples {
        blob: blob_digest(&fewer),
        samples: 1,
        max_loss_increase_bps: 100,
    };
    let entries = aggregator.state().entries();
    let refused = propose(&mut aggregator, rule).unwrap_err();
    assert!(matches!(refused, RequestError::PublicSamples(_)));
    assert!(
        refused.to_string().contains("there is no blob"),
        "{refused}"
    );
    aggregator.ledger().blobs().put(&fewer)?;
    let two = PublicSamples { samples: 2, ..rule };
    let refused = propose(&mut aggregator, two).unwrap_err();
    assert!(
        refused.to_string().contains("the rules count 2"),
        "{refused}"
    );
    // The ledger has gone on as if nobody had asked.
    assert_eq!(aggregator.state().entries(), entries);
    propose(&mut aggregator, rule)?;
    assert_eq!(aggregator.state().entries(), entries + 1);
    Ok(())
}
