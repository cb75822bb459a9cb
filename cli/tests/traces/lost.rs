//! A collector that is down, or that accepts connections and then states nothing.

use super::collector::{serving, Collector};
use crate::harness::network::LocalNetwork;
use crate::harness::serving::Serving;
use crate::harness::{prints, words};
use std::net::TcpListener;
use std::thread;
use std::time::{Duration, Instant};
use zk0_testkit::own_port::OwnPort;

/// Spans are sent this often, so that a test sees several attempts.
const OFTEN: (&str, &str) = ("OTEL_BSP_SCHEDULE_DELAY", "20");

/// Less than a collector has to answer, which is ten seconds.
const SOON: Duration = Duration::from_secs(9);

/// An aggregator that sends its traces to `collector`, and the id of its network.
struct Traced {
    aggregator: Serving,
    id: String,
    _network: LocalNetwork,
}

impl Traced {
    fn start(collector: &str, variables: &[(&str, &str)]) -> Self {
        let network = LocalNetwork::new();
        network.found(&[]);
        let arguments = serving(&network, collector);
        Self {
            aggregator: Serving::start_with(&words(&arguments), variables),
            id: network.genesis().network_id().to_string(),
            _network: network,
        }
    }

    /// Asks the aggregator for its status. It makes spans.
    fn ask(&self) {
        let status = ["status", "--network", &self.id, "--aggregator"];
        prints(&[&status[..], &[&self.aggregator.address]].concat());
    }

    /// Tells the aggregator to end. It waits for no collector.
    fn ends(mut self) {
        let begun = Instant::now();
        assert!(self.aggregator.terminate().success());
        let took = begun.elapsed();
        assert!(took < SOON, "{took:?}");
    }
}

#[test]
fn a_collector_that_is_down_is_logged_once_and_gets_traces_when_it_is_there() {
    let port = OwnPort::take();
    let traced = Traced::start(&format!("http://{}", port.address()), &[OFTEN]);
    for _ in 0..6 {
        traced.ask();
        thread::sleep(Duration::from_millis(60));
    }
    traced.aggregator.logs("takes no traces");
    let log = traced.aggregator.log();
    assert_eq!(log.matches("takes no traces").count(), 1, "{log}");
    assert!(!log.contains("takes traces again"), "{log}");

    let collector = Collector::on(&port.address(), None);
    traced.ask();
    collector.receives("zk0.v1.Federation/GetStatus");
    traced.aggregator.logs("takes traces again");
    drop(collector);
    traced.ask();
    traced.ends();
}

#[test]
fn a_collector_that_never_answers_holds_nobody_up() {
    let silent = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = format!("http://{}", silent.local_addr().unwrap());
    thread::spawn(move || {
        let connections: Vec<_> = silent.incoming().collect();
        drop(connections);
    });
    // The queue is soon full.
    let few = ("OTEL_BSP_MAX_QUEUE_SIZE", "4");
    let traced = Traced::start(&address, &[OFTEN, few]);
    for _ in 0..10 {
        let begun = Instant::now();
        traced.ask();
        let took = begun.elapsed();
        assert!(took < SOON, "{took:?}");
    }
    traced.aggregator.logs("takes no traces");
    traced.ask();
    traced.ends();
}
