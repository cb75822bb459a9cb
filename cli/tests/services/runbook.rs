//! The failures of `docs/runbook.md`, provoked: what is printed is what the page states.

use crate::harness::network::LocalNetwork;
use crate::harness::serving::Serving;
use crate::harness::{as_in_the_runbook, copy, fails, prints, words, zk0, RECORDING};
use serde_json::Value;
use std::fs;
use std::io::{BufRead, BufReader};
use std::net::TcpListener;
use std::os::unix::fs::PermissionsExt;
use std::path::Path;
use std::process::Stdio;
use std::time::Duration;
use zk0_testkit::own_port::OwnPort;

fn founded() -> LocalNetwork {
    let network = LocalNetwork::new();
    network.found(&[]);
    network
}

fn serve(network: &LocalNetwork, listen: &str) -> Vec<String> {
    let (ledger, key) = (network.path("ledger"), network.path("log.key"));
    [
        "aggregator",
        "serve",
        &ledger,
        "--key",
        &key,
        "--listen",
        listen,
    ]
    .map(str::to_owned)
    .into()
}

#[test]
fn a_port_that_is_in_use() {
    let (network, other) = (founded(), founded());
    let serving = Serving::start(&words(&serve(&network, "127.0.0.1:0")));
    let address = serving.address.trim_start_matches("http://");
    let reported = fails(&words(&serve(&other, address)));
    as_in_the_runbook(&reported, "already: stop it, or choose another address");
    assert!(reported.contains(address), "{reported}");
}

#[test]
fn a_port_of_the_log_or_of_the_metrics_that_is_in_use() {
    let network = founded();
    let other = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = other.local_addr().unwrap().to_string();
    for option in ["--log-listen", "--metrics"] {
        let mut arguments = serve(&network, "127.0.0.1:0");
        arguments.extend([option.to_owned(), address.clone()]);
        let reported = fails(&words(&arguments));
        let mend = format!("another process listens on {address} already");
        assert!(reported.contains(&mend), "{reported}");
        // Nobody reads that an aggregator serves which then ends.
        assert!(
            !reported.contains("the aggregator of network"),
            "{reported}"
        );
    }
}

#[test]
fn a_ledger_that_another_process_has() {
    let network = founded();
    let _serving = Serving::start(&words(&serve(&network, "127.0.0.1:0")));
    let reported = fails(&words(&serve(&network, "127.0.0.1:0")));
    as_in_the_runbook(
        &reported,
        "is in use by another process: stop that process first",
    );
    let (ledger, key) = (network.path("ledger"), network.path("log.key"));
    let node = format!("bob={}", "11".repeat(32));
    let reported = fails(&[
        "aggregator",
        "enrol",
        &ledger,
        "--key",
        &key,
        "--node",
        &node,
    ]);
    as_in_the_runbook(
        &reported,
        "is in use, most likely by its running aggregator: enrol through that",
    );
    // It states one way, and not two.
    assert!(!reported.contains("stop that process"), "{reported}");
}

#[test]
fn a_node_that_is_not_enrolled_and_a_prover_that_nobody_reaches() {
    let network = founded();
    let serving = Serving::start(&words(&serve(&network, "127.0.0.1:0")));
    let id = network.genesis().network_id().to_string();
    let (key, stranger) = (network.path("node.key"), network.path("stranger.key"));
    prints(&["node", "keygen", &stranger]);
    let join = |key: &str, prover: &str| {
        let state = network.path("state");
        let mut arguments = vec![
            "node",
            "join",
            "--aggregator",
            &serving.address,
            "--network",
            &id,
        ];
        arguments.extend([
            "--key",
            key,
            "--dataset",
            RECORDING,
            "--state",
            &state,
            "--prover",
            prover,
        ]);
        fails(&arguments)
    };
    let nobody = "http://127.0.0.1:9";
    let reported = join(&key, nobody);
    as_in_the_runbook(
        &reported,
        "cannot be reached: Connection refused (os error 111); `zk0 prover serve` runs it",
    );
    assert_eq!(reported.matches(nobody).count(), 1, "{reported}");
    assert!(!reported.contains("chmod"), "{reported}");
    // With a proving service, the node comes as far as the aggregator. Its folder has become one that others can look into.
    let prover = network.prover();
    let state = network.path("state");
    fs::set_permissions(&state, fs::Permissions::from_mode(0o755)).unwrap();
    let reported = join(&stranger, &prover.address);
    let mend = format!("run `chmod 700 {state}`");
    assert!(reported.contains(&mend), "{reported}");
    as_in_the_runbook(&reported, "is not enrolled in this network");
}

#[test]
fn a_disk_that_takes_no_more() {
    let network = founded();
    let arguments = serve(&network, "127.0.0.1:0");
    let mut serving = Serving::start(&words(&arguments));
    let id = network.genesis().network_id().to_string();
    // The checkpoint cannot be written where a folder is.
    let (checkpoint, kept) = (network.path("ledger/checkpoint"), network.path("kept"));
    fs::rename(&checkpoint, &kept).unwrap();
    fs::create_dir_all(Path::new(&checkpoint).join("in-the-way")).unwrap();
    let (key, node) = (network.path("log.key"), format!("bob={}", "11".repeat(32)));
    let mut enrol = vec!["aggregator", "enrol", "--aggregator", &serving.address];
    enrol.extend(["--network", &id, "--key", &key, "--node", &node]);
    as_in_the_runbook(&fails(&enrol), "the aggregator failed; its log states why");
    // It can record nothing any more, so it ends, and whoever watches it notices.
    assert_eq!(
        serving
            .ended_within(Duration::from_secs(10))
            .unwrap()
            .code(),
        Some(1)
    );

    fs::remove_dir_all(&checkpoint).unwrap();
    fs::rename(&kept, &checkpoint).unwrap();
    let again = Serving::start(&words(&arguments));
    let status = ["status", "--aggregator", &again.address, "--network", &id];
    assert!(prints(&status).contains("round 0"));
}

#[test]
fn a_backup_that_is_older_than_the_last_checkpoint() {
    let network = founded();
    let [ledger, key, backup] = ["ledger", "log.key", "backup"].map(|name| network.path(name));
    prints(&["ledger", "backup", &ledger, &backup]);
    let old = network.path("old");
    copy(Path::new(&ledger), Path::new(&old));
    let node = format!("bob={}", "11".repeat(32));
    prints(&[
        "aggregator",
        "enrol",
        &ledger,
        "--key",
        &key,
        "--node",
        &node,
    ]);
    let newest = network.path("newest");
    fs::copy(Path::new(&ledger).join("checkpoint"), &newest).unwrap();
    let restored = network.path("restored");
    let reported = fails(&[
        "ledger",
        "restore",
        &backup,
        &restored,
        "--checkpoint",
        &newest,
    ]);
    as_in_the_runbook(&reported, "to go on from this backup would fork the log");
    // Somebody copies the old database back by hand.
    let database = Path::new(&ledger).join("log");
    fs::remove_dir_all(&database).unwrap();
    copy(&Path::new(&old).join("log"), &database);
    let reported = fails(&words(&serve(&network, "127.0.0.1:0")));
    as_in_the_runbook(&reported, "the database was rolled back or damaged. Restore the newest copy; until then nothing is signed");
}

#[test]
fn an_aggregator_that_is_killed() {
    let (network, port) = (founded(), OwnPort::take());
    let arguments = serve(&network, &port.address());
    let mut serving = Serving::start(&words(&arguments));
    let id = network.genesis().network_id().to_string();
    let mut watch = vec!["status", "--watch", "--json", "--network", &id];
    let before = serving.address.clone();
    watch.extend(["--aggregator", &before]);
    let mut watching = zk0(&watch).stdout(Stdio::piped()).spawn().unwrap();
    let mut shown = BufReader::new(watching.stdout.take().unwrap()).lines();
    let mut up = || {
        let status: Value = serde_json::from_str(&shown.next().unwrap().unwrap()).unwrap();
        status["uptime_ms"].as_u64().unwrap()
    };
    while up() < 3000 {}
    serving.kill();
    let reported = fails(&["status", "--aggregator", &before, "--network", &id]);
    as_in_the_runbook(
        &reported,
        "cannot be reached: Connection refused (os error 111)",
    );
    // The same command goes on with the same ledger.
    let again = Serving::start(&words(&arguments));
    let status = ["status", "--aggregator", &again.address, "--network", &id];
    assert!(prints(&status).contains("the newest checkpoint covers 2"));
    // Whoever watches sees the one that has just started.
    while up() > 3000 {}
    watching.kill().unwrap();
    watching.wait().unwrap();
}
