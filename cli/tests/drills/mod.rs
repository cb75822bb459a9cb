//! Drills that no other test plays: what happens to a network once in months, and people who mend it with the commands of docs/runbook.md.
//! `testkit/tests/drills.txt` names all drills.

mod log_keys;
mod long_history;
mod outages;
mod stolen_keys;
mod witnesses;
mod wrong_clock;

use crate::harness::drill::Drill;
use crate::harness::serving::Serving;
use crate::harness::{ends, logged, logs, printed, prints, text, words};
use crate::pages::Reader;
use serde_json::Value;
use std::fs;
use std::path::Path;
use zk0::keys;
use zk0_audit::verified_entries::verified_entries;
use zk0_circuits::NodeId;
use zk0_protocol::entries::entry::{Body, Entry};
use zk0_protocol::entries::proposal::Outcome;
use zk0_testkit::own_port::OwnPort;
use zk0_testkit::until;

const PAGE: &str = "docs/runbook.md";

/// People type their votes within this time.
const VOTING_MS: u64 = 10_000;
const SHORT_VOTE: &str = "a vote takes 10 seconds and not four days";

/// A network of one node, which has no recording, and the folder of its people, with all keys.
struct Operated {
    reader: Reader,
    port: OwnPort,
}

impl Operated {
    /// Founds a network with these governors, whose keys are in files of their names. `change` edits its rules.
    fn found(governors: &[&str], change: impl FnOnce(&mut Value)) -> Self {
        Self::found_with(&[], governors, change)
    }

    /// [`Self::found`] with these options of `init` more. Files are in the folder.
    fn found_with(
        more: &[(&str, &str)],
        governors: &[&str],
        change: impl FnOnce(&mut Value),
    ) -> Self {
        let mut operated = Self {
            reader: Reader::new(),
            port: OwnPort::take(),
        };
        let node = format!("node={}", operated.keygen("node"));
        operated.keygen("log");
        let mut rules = vec!["aggregator".to_owned(), "rules".to_owned()];
        for name in governors {
            let governor = format!("{name}={}", operated.keygen(name));
            rules.extend(["--governor".to_owned(), governor]);
        }
        let mut rules: Value = serde_json::from_str(&prints(&words(&rules))).unwrap();
        rules["governance"]["voting_ms"] = VOTING_MS.into();
        rules["governance"]["time_lock_ms"] = 1.into();
        change(&mut rules);
        let [ledger, key, file] = ["ledger", "log.key", "founding.json"].map(|n| operated.path(n));
        fs::write(&file, rules.to_string()).unwrap();
        let init = ["aggregator", "init", &ledger, "--name", "drill", "--key"];
        let more = more
            .iter()
            .map(|(option, file)| [(*option).to_owned(), operated.path(file)]);
        let more: Vec<String> = more.flatten().collect();
        let founding = [&init[..], &[&*key, "--rules", &file, "--node", &node]].concat();
        logs(&[&founding[..], &words(&more)].concat());
        let Body::Genesis(genesis) = operated.entries().remove(0).body else {
            unreachable!()
        };
        let (address, id) = (operated.port.address(), genesis.network_id());
        let at = format!("--aggregator http://{address} --network {id}");
        operated.reader.fills_in("$AT", at);
        operated
    }

    /// Makes the file of a key.
    fn keygen(&self, name: &str) -> NodeId {
        keys::generate(&self.reader.path(&format!("{name}.key"))).unwrap()
    }

    fn path(&self, name: &str) -> String {
        text(&self.reader.path(name)).to_owned()
    }

    /// Starts the aggregator, at the same address as before.
    fn serves(&self, more: &[&str]) -> Serving {
        self.serves_with(more, &[])
    }

    fn serves_with(&self, more: &[&str], variables: &[(&str, &str)]) -> Serving {
        self.serves_by("log.key", more, variables)
    }

    /// The same, with the log's key in this file.
    fn serves_by(&self, key: &str, more: &[&str], variables: &[(&str, &str)]) -> Serving {
        let (ledger, key, listen) = (self.path("ledger"), self.path(key), self.port.address());
        let begin = ["aggregator", "serve", &ledger, "--key", &key];
        let begin = [&begin[..], &["--listen", &listen]].concat();
        Serving::start_with(&[&begin[..], more].concat(), variables)
    }

    /// Somebody types a command of the runbook, which has to succeed. Returns what it prints.
    #[track_caller]
    fn follows(&self, drill: &mut Drill, begin: &str) -> String {
        let command = Reader::on_page(PAGE, begin);
        drill.typed.push(command.clone());
        self.succeeds(&command)
    }

    /// Runs a command in the folder, which has to succeed. Returns what it prints.
    #[track_caller]
    fn succeeds(&self, command: &str) -> String {
        printed(&ends(0, self.reader.types(command.to_owned())))
    }

    /// The log of a command that has to fail.
    #[track_caller]
    fn fails(&self, command: &str) -> String {
        logged(&ends(1, self.reader.types(command.to_owned())))
    }

    fn entries(&self) -> Vec<Entry> {
        let ledger = self.path("ledger");
        verified_entries(Path::new(&ledger)).unwrap().0
    }

    /// Waits until so many rounds have closed.
    #[track_caller]
    fn closes(&self, rounds: usize) {
        until(format!("{rounds} rounds close"), || {
            closed(&self.entries()) >= rounds
        });
    }

    /// Enrols a node through the running aggregator.
    #[track_caller]
    fn enrols(&self, name: &str) {
        self.enrols_by("log.key", name);
    }

    /// The same, with the log's key in this file.
    #[track_caller]
    fn enrols_by(&self, key: &str, name: &str) {
        let node = self.keygen(name);
        self.succeeds(&format!(
            "zk0 aggregator enrol $AT --key {key} --node {name}={node}"
        ));
    }

    /// Somebody edits the rules in force, and proposes them. The governors with these keys vote for that.
    #[track_caller]
    fn votes_rules(&self, drill: &mut Drill, voters: &[&str], edit: impl FnOnce(&mut Value)) {
        self.follows(drill, "zk0 governance status $AT --rules");
        let file = self.path("rules.json");
        let mut rules = serde_json::from_str(&fs::read_to_string(&file).unwrap()).unwrap();
        edit(&mut rules);
        fs::write(&file, rules.to_string()).unwrap();
        let propose = "zk0 governance propose $AT --key governor.key --title \"stolen\" rules";
        self.follows(drill, propose);
        self.vote(drill, voters);
    }

    /// The governors with these keys vote for proposal 0.
    #[track_caller]
    fn vote(&self, drill: &mut Drill, voters: &[&str]) {
        let vote = Reader::on_page(PAGE, "zk0 governance vote $AT");
        for voter in voters {
            self.succeeds(&vote.replace("governor.key", &format!("{voter}.key")));
        }
        drill.typed.push(vote);
    }

    /// Waits until the proposal is settled, and checks that it is carried out.
    #[track_caller]
    fn is_carried_out(&self) {
        let settled = || {
            let mut entries = self.entries().into_iter();
            entries.find_map(|entry| match entry.body {
                Body::ProposalSettled(settled) => Some(settled.outcome),
                _ => None,
            })
        };
        let outcome = until("the proposal is settled", settled);
        assert_eq!(outcome, Outcome::Executed);
    }

    /// What the running aggregator states of itself, in trouble or not.
    fn status(&self) -> Value {
        until("the status is shown", || {
            let mut status = self.reader.types("zk0 status $AT --json".to_owned());
            serde_json::from_slice(&status.output().unwrap().stdout).ok()
        })
    }

    /// Whether the running aggregator has this trouble.
    fn has_trouble(&self, kind: &str) -> bool {
        let status = self.status();
        let trouble = status["trouble"].as_array();
        trouble.is_some_and(|all| all.iter().any(|one| one["kind"] == kind))
    }
}

/// How many rounds have closed.
fn closed(entries: &[Entry]) -> usize {
    let closed = |entry: &&Entry| matches!(entry.body, Body::RoundClosed(_));
    entries.iter().filter(closed).count()
}
