//! No round opens that could not be closed, because a file that its strategy reads is lost.

mod harness;

use harness::operator::Operator;
use harness::*;
use std::fs;
use std::sync::Arc;
use zk0_aggregator::{Aggregator, Config, Progress};
use zk0_protocol::rules::network_rules::Strategy;

const CONFIG: Config = Config {
    rounds: None,
    min_nodes: 1,
};

#[test]
fn no_round_opens_without_the_weights_that_its_momentum_starts_from() {
    for (momentum_bps, needs_it) in [(9000, true), (0, false)] {
        let dir = tempfile::tempdir().unwrap();
        let mut founded = genesis();
        founded.rules.strategy = Strategy::FedAvgM {
            server_rate_bps: 10_000,
            momentum_bps,
        };
        let node = Node::new(1);
        let mut operator = Operator::founds(dir.path(), founded, &[&node]);
        let initial = operator.state().global().blob;
        operator.round(&node, 1, &[1]);
        let lost = operator.ledger.blobs().path(&initial);
        let clock = Arc::new(ManualClock::at(operator.time_ms));
        drop(operator);
        let mut aggregator = Aggregator::open(dir.path(), None, log_key(), clock, CONFIG).unwrap();
        let file = fs::read(&lost).unwrap();
        fs::remove_file(&lost).unwrap();
        if needs_it {
            let Progress::Blocked(why) = aggregator.step().unwrap() else {
                panic!("it opened a round");
            };
            let expected = format!("its strategy reads the weights {initial}");
            assert!(why.contains(&expected), "{why}");
            fs::write(&lost, file).unwrap();
        }
        assert_eq!(aggregator.step().unwrap(), Progress::Opened(1));
    }
}
