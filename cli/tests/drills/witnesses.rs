//! A witness is down, is gone for ever, or has lost its key to a thief.

use super::{Operated, PAGE, SHORT_VOTE};
use crate::harness::drill::Drill;
use crate::harness::process::Process;
use crate::harness::serving::Serving;
use crate::harness::{as_in_the_runbook, copy, ends, fails, logged, logs, prints, text, zk0};
use crate::pages::Reader;
use serde_json::Value;
use std::fs;
use std::path::Path;
use std::time::Duration;
use tempfile::TempDir;
use zk0_testkit::own_port::OwnPort;
use zk0_testkit::until;

/// The aggregator ends so if a witness contradicts.
const CONTRADICTED: &str = "the ledger does not go on from what a witness has cosigned";

/// The longest time until a witness that was away has answered.
const ANSWERED: Duration = Duration::from_secs(120);

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

    /// A thief of the log's key has these cosign a copy of the ledger with another entry. The others are off then, and so are these.
    fn cosign_a_fork(&mut self, of: &[usize], network: &Operated) {
        let [ledger, fork, key] = ["ledger", "fork", "log.key"].map(|name| network.path(name));
        copy(Path::new(&ledger), Path::new(&fork));
        let node = format!("mallory={}", network.keygen("mallory"));
        let enrol = ["aggregator", "enrol", &fork, "--key", &key, "--node", &node];
        logs(&enrol);
        (0..self.all.len()).for_each(|number| self.off(number));
        of.iter().for_each(|number| self.on(*number, network));
        let serve = ["aggregator", "serve", &fork, "--key", &key];
        let more = ["--listen", "127.0.0.1:0"];
        // It listens once they have cosigned.
        drop(Serving::start(&[&serve[..], &more, &SOON].concat()));
        of.iter().for_each(|number| self.off(*number));
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
    ends_contradicted(&mut aggregator);
}

/// Waits until the aggregator ends because a witness contradicts.
#[track_caller]
fn ends_contradicted(aggregator: &mut Serving) {
    let ended = aggregator.ended_within(ANSWERED);
    assert_eq!(ended.and_then(|ended| ended.code()), Some(2));
    as_in_the_runbook(&aggregator.log(), CONTRADICTED);
}

#[test]
fn one_witness_of_a_thiefs_fork_stops_no_network() {
    let mut witnesses = Witnesses::made(3);
    let network = found(&mut witnesses, &[0, 1, 2], 2);
    let mut aggregator = network.serves(&SOON);
    is_published(&network);
    assert!(aggregator.terminate().success());

    let mut drill = Drill::begin("the log's key is stolen");
    witnesses.cosign_a_fork(&[2], &network);
    // This process has no checkpoint of its own yet: what a quorum cosigns at the start, another aggregator can have, too.
    (0..2).for_each(|number| witnesses.on(number, &network));
    let mut aggregator = network.serves(&SOON);
    witnesses.on(2, &network);
    ends_contradicted(&mut aggregator);

    witnesses.off(2);
    let mut aggregator = network.serves(&SOON);
    network.enrols("bob");
    is_published(&network);
    witnesses.on(2, &network);
    aggregator.logs("witness W2 refuses (status 409)");
    until("the operator sees it", || {
        let trouble = network.status()["trouble"].to_string();
        trouble.contains("these witnesses have cosigned other entries, or more: W2;")
    });
    network.enrols("carol");
    is_published(&network);
    assert!(aggregator.terminate().success());

    let (ledger, key) = (network.path("ledger"), network.path("log.key"));
    let serve = ["aggregator", "serve", &ledger, "--key", &key];
    let serve = [&serve[..], &["--listen", "127.0.0.1:0"], &SOON].concat();
    let ended = logged(&ends(2, zk0(&serve)));
    as_in_the_runbook(&ended, CONTRADICTED);
    as_in_the_runbook(&ended, "--ignore-witness NAME");
    let refused = fails(&[&serve[..], &["--ignore-witness", "W3"]].concat());
    assert!(refused.contains("W0, W1, W2"), "{refused}");
    let most = ["--ignore-witness", "W1", "--ignore-witness", "W2"];
    let refused = fails(&[&serve[..], &most].concat());
    as_in_the_runbook(&refused, "the rest is no quorum");
    let begin = "zk0 aggregator serve ledger --key log.key --ignore-witness";
    drill.typed.push(Reader::on_page(PAGE, begin));
    let start = [&SOON[..], &["--ignore-witness", "W2"]].concat();
    let _aggregator = network.serves(&start);
    network.enrols("dave");
    is_published(&network);
    drill.passed();
}

#[test]
fn a_log_without_witnesses_has_none_to_ignore() {
    let network = Operated::found(&["governor"], |_| {});
    let (ledger, key) = (network.path("ledger"), network.path("log.key"));
    let serve = ["aggregator", "serve", &ledger, "--key", &key];
    let refused = fails(
        &[
            &serve[..],
            &["--listen", "127.0.0.1:0", "--ignore-witness", "W0"],
        ]
        .concat(),
    );
    assert!(
        refused.contains("this log has no witness policy"),
        "{refused}"
    );
}

#[test]
fn a_quorum_of_a_thiefs_fork_is_voted_away() {
    let mut witnesses = Witnesses::made(5);
    let policy = witnesses.policy(&[0, 1, 2], 2);
    let edit = |rules: &mut Value| rules["witness_policy"] = policy;
    let operator = [("--operator-key", "operator.key")];
    let network = Operated::found_with(&operator, &["governor"], edit);
    (0..3).for_each(|number| witnesses.on(number, &network));
    let mut aggregator = network.serves(&SOON);
    is_published(&network);

    let mut drill = Drill::begin("the log's key is stolen");
    drill.shortened = Some(SHORT_VOTE);
    assert!(aggregator.terminate().success());
    witnesses.cosign_a_fork(&[1, 2], &network);
    (0..5).for_each(|number| witnesses.on(number, &network));
    network.follows(&mut drill, "zk0 aggregator keygen new.key");
    network.follows(&mut drill, "zk0 aggregator rotate-log-key ledger");
    // Another key does not change what they have cosigned.
    let (ledger, key) = (network.path("ledger"), network.path("new.key"));
    let serve = ["aggregator", "serve", &ledger, "--key", &key];
    let serve = [&serve[..], &["--listen", "127.0.0.1:0"], &SOON].concat();
    as_in_the_runbook(&logged(&ends(2, zk0(&serve))), CONTRADICTED);
    let ignored = ["--ignore-witness", "W1", "--ignore-witness", "W2"];
    let refused = fails(&[&serve[..], &ignored].concat());
    as_in_the_runbook(&refused, "the rest is no quorum");

    let size = size(&network);
    let newest = ["--newest-checkpoint", &size];
    let start = [&SOON[..], &newest, &ignored].concat();
    let aggregator = network.serves_by("new.key", &start, &[]);
    let policy = witnesses.policy(&[0, 3, 4], 2);
    let edit = |rules: &mut Value| rules["witness_policy"] = policy;
    network.votes_rules(&mut drill, &["governor"], edit);
    network.is_carried_out();
    aggregator.logs("start the aggregator again with it");
    drop(aggregator);
    let _aggregator = network.serves_by("new.key", &SOON, &[]);
    is_published(&network);
    network.enrols_by("new.key", "bob");
    is_published(&network);
    drill.passed();
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
