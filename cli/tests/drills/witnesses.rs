//! A witness is down, is gone for ever, or has lost its key to a thief.

use super::{Operated, SHORT_VOTE};
use crate::harness::drill::Drill;
use crate::harness::process::Process;
use crate::harness::serving::Serving;
use crate::harness::{as_in_the_runbook, copy, fails, prints, text};
use serde_json::Value;
use std::fs;
use std::path::Path;
use std::time::Duration;
use tempfile::TempDir;
use zk0_testkit::own_port::OwnPort;
use zk0_testkit::until;

/// People whose requests are not cosigned do not wait for long.
const SOON: [&str; 2] = ["--witness-seconds", "1"];

/// Witnesses of one network, each with its own process while it is on.
pub(super) struct Witnesses {
    dir: TempDir,
    all: Vec<(String, OwnPort, Option<Serving>)>,
}

impl Witnesses {
    pub(super) fn made(count: usize) -> Self {
        let dir = tempfile::tempdir().unwrap();
        let all = (0..count).map(|number| {
            let key = dir.path().join(format!("{number}.key"));
            let keygen = ["witness", "keygen", text(&key), "--name", &name(number)];
            let made = prints(&keygen);
            (made.trim().to_owned(), OwnPort::take(), None)
        });
        let all = all.collect();
        Self { dir, all }
    }

    /// The rule that asks for so many of these witnesses.
    pub(super) fn policy(&self, of: &[usize], quorum: usize) -> Value {
        let line = |number: &usize| {
            let (key, port, _) = &self.all[*number];
            format!("witness W{number} {key} http://{}\n", port.address())
        };
        let lines: String = of.iter().map(line).collect();
        let names: String = of.iter().map(|number| format!(" W{number}")).collect();
        format!("{lines}group some {quorum}{names}\nquorum some\n").into()
    }

    /// Starts a witness of this network.
    pub(super) fn on(&mut self, number: usize, network: &Operated) {
        let log = prints(&["ledger", "vkey", &network.path("ledger")]);
        let path = |name: String| text(&self.dir.path().join(name)).to_owned();
        let (folder, key) = (path(number.to_string()), path(format!("{number}.key")));
        let (name, listen) = (name(number), self.all[number].1.address());
        let serve = ["witness", "serve", &folder, "--key", &key, "--name", &name];
        let more = ["--log-key", log.trim(), "--listen", &listen];
        let serving = Serving::start(&[&serve[..], &more].concat());
        self.all[number].2 = Some(serving);
    }

    /// Ends it.
    fn off(&mut self, number: usize) {
        self.all[number].2 = None;
    }
}

fn name(number: usize) -> String {
    format!("witness.example/w{number}")
}

/// Founds a network whose rules ask for so many of these witnesses, and starts them.
fn found(witnesses: &mut Witnesses, of: &[usize], quorum: usize) -> Operated {
    let policy = witnesses.policy(of, quorum);
    let network = Operated::found(&["governor"], |rules| rules["witness_policy"] = policy);
    of.iter().for_each(|number| witnesses.on(*number, &network));
    network
}

/// The size of the newest checkpoint in the ledger's folder.
fn size(network: &Operated) -> String {
    let checkpoint = fs::read_to_string(network.path("ledger/checkpoint")).unwrap();
    checkpoint.lines().nth(1).unwrap().to_owned()
}

/// Waits until all entries are published.
#[track_caller]
pub(super) fn is_published(network: &Operated) {
    until("all is published", || {
        let status = network.status();
        status["published"] == status["entries"]
    });
}

/// A vote puts this policy in force, which ends the aggregator. It is started again.
fn is_replaced(network: &Operated, drill: &mut Drill, policy: Value, before: Serving) -> Serving {
    let edit = |rules: &mut Value| rules["witness_policy"] = policy;
    network.votes_rules(drill, &["governor"], edit);
    network.is_carried_out();
    before.logs("start the aggregator again with it");
    drop(before);
    network.serves(&SOON)
}

#[test]
fn a_quorum_goes_on_without_a_witness_that_is_down() {
    let mut witnesses = Witnesses::made(3);
    let network = found(&mut witnesses, &[0, 1, 2], 2);
    let _aggregator = network.serves(&SOON);
    is_published(&network);

    let mut drill = Drill::begin("a witness is down for a day");
    drill.shortened = Some("the witness is down for seconds and not for a day");
    witnesses.off(2);
    network.enrols("bob");
    is_published(&network);
    let away = "witness_away";
    until("the operator sees it", || network.has_trouble(away));
    witnesses.on(2, &network);
    until("the witness cosigns again", || !network.has_trouble(away));
    drill.passed();
}

#[test]
fn a_policy_of_a_dead_witness_is_voted_away() {
    let mut witnesses = Witnesses::made(2);
    let network = found(&mut witnesses, &[0], 1);
    let aggregator = network.serves(&SOON);
    is_published(&network);
    witnesses.on(1, &network);

    let mut drill = Drill::begin("the policy has a dead witness");
    drill.shortened = Some(SHORT_VOTE);
    witnesses.off(0);
    // The aggregator is started again, too, before anybody votes.
    drop(aggregator);
    let size = size(&network);
    let (ledger, key) = (network.path("ledger"), network.path("log.key"));
    let serve = ["aggregator", "serve", &ledger, "--key", &key];
    let serve = [&serve[..], &["--listen", "127.0.0.1:0"], &SOON].concat();
    let waiting: Vec<_> = serve.iter().map(|word| (*word).to_owned()).collect();
    Process::start(&waiting).reports("no witness answers, so nobody knows");
    let reported = fails(&[&serve[..], &["--newest-checkpoint", "1"]].concat());
    let wrong = format!("states 1 entry, but the ledger has {size} entries: ");
    assert!(reported.contains(&wrong), "{reported}");
    let start = [&SOON[..], &["--newest-checkpoint", &size]].concat();
    let aggregator = network.serves(&start);
    let policy = witnesses.policy(&[1], 1);
    let _aggregator = is_replaced(&network, &mut drill, policy, aggregator);
    is_published(&network);
    network.enrols("bob");
    drill.passed();
}

/// The operator is wrong about the folder, and so is a witness that lacks the newest entries. Another one shows that when it is back, and
/// nothing was published before.
#[test]
fn an_aggregator_on_an_older_copy_ends_when_a_witness_of_the_newest_one_is_back() {
    let mut witnesses = Witnesses::made(3);
    let network = found(&mut witnesses, &[0, 1, 2], 2);
    let runs = |enrolled: &[&str]| {
        let mut aggregator = network.serves(&SOON);
        enrolled.iter().for_each(|name| network.enrols(name));
        is_published(&network);
        assert!(aggregator.terminate().success());
    };
    runs(&[]);
    let [ledger, older] = ["ledger", "older"].map(|name| network.path(name));
    copy(Path::new(&ledger), Path::new(&older));
    witnesses.off(2);
    runs(&["bob"]);
    fs::remove_dir_all(&ledger).unwrap();
    fs::rename(&older, &ledger).unwrap();
    for number in [0, 1] {
        witnesses.off(number);
    }
    let size = size(&network);
    let start = [&SOON[..], &["--newest-checkpoint", &size]].concat();
    let mut aggregator = network.serves(&start);
    witnesses.on(2, &network);
    aggregator.logs("witness W2 cosigns again");
    witnesses.on(0, &network);
    let ended = aggregator.ended_within(Duration::from_secs(120));
    assert_eq!(ended.and_then(|ended| ended.code()), Some(2));
    as_in_the_runbook(
        &aggregator.log(),
        "the ledger does not go on from what a witness has cosigned",
    );
}

#[test]
fn a_witness_whose_key_is_stolen_is_replaced() {
    let mut witnesses = Witnesses::made(4);
    let network = found(&mut witnesses, &[0, 1, 2], 2);
    let aggregator = network.serves(&SOON);
    is_published(&network);
    witnesses.on(3, &network);

    let mut drill = Drill::begin("a witness's key is stolen");
    drill.shortened = Some(SHORT_VOTE);
    let policy = witnesses.policy(&[0, 1, 3], 2);
    let _aggregator = is_replaced(&network, &mut drill, policy, aggregator);
    is_published(&network);
    // The thief's cosignature does not count, and that of the new witness does.
    witnesses.off(1);
    let begun = network.status()["entries"].as_u64();
    network.enrols("bob");
    is_published(&network);
    assert!(network.status()["published"].as_u64() > begun);
    drill.passed();
}
