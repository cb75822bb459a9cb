//! What an operator sees of a running aggregator: its metrics and its status.

use crate::harness::network::LocalNetwork;
use crate::harness::shown::Shown;
use crate::harness::{ends, json, logged, printed, prints, zk0};
use serde_json::Value;
use std::fs;
use std::io::{BufRead, BufReader};
use std::net::TcpStream;
use std::path::Path;
use std::process::{Child, Stdio};
use std::thread;
use zk0_protocol::rpc::federation::trouble::Kind;
use zk0_testkit::until;

/// The exit code of `zk0 status` if the aggregator has trouble.
const TROUBLE: i32 = 3;

fn founded() -> LocalNetwork {
    let network = LocalNetwork::new();
    network.found(&[]);
    network
}

/// A running aggregator with metrics.
struct Observed {
    network: LocalNetwork,
    process: Child,
    address: String,
    shown: Shown,
}

impl Drop for Observed {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

impl Observed {
    /// Founds a network of one node, and serves it.
    fn serve(more: &[&str]) -> Self {
        Self::serve_network(founded(), more)
    }

    fn serve_network(network: LocalNetwork, more: &[&str]) -> Self {
        let (ledger, key) = (network.path("ledger"), network.path("log.key"));
        let mut command = zk0(&[
            "--log",
            "json",
            "aggregator",
            "serve",
            &ledger,
            "--key",
            &key,
        ]);
        command.args(["--listen", "127.0.0.1:0", "--metrics", "127.0.0.1:0"]);
        let mut process = command.args(more).stderr(Stdio::piped()).spawn().unwrap();
        let mut log = BufReader::new(process.stderr.take().unwrap());
        let (mut address, mut metrics) = (None, None);
        while address.is_none() || metrics.is_none() {
            let mut line = String::new();
            assert!(
                log.read_line(&mut line).unwrap() > 0,
                "the aggregator has ended"
            );
            let line: Value = serde_json::from_str(&line).unwrap();
            let named = |name: &str| Some(line[name].as_str()?.to_owned());
            address = address.or_else(|| named("listening"));
            metrics = metrics.or_else(|| named("metrics"));
        }
        thread::spawn(move || std::io::copy(&mut log, &mut std::io::sink()));
        Self {
            network,
            process,
            address: format!("http://{}", address.unwrap()),
            shown: Shown(metrics.unwrap()),
        }
    }

    fn of_network(&self) -> [String; 4] {
        let id = self.network.genesis().network_id().to_string();
        [
            "--aggregator".into(),
            self.address.clone(),
            "--network".into(),
            id,
        ]
    }

    fn asking<'a>(&'a self, words: &[&'a str], of: &'a [String; 4]) -> Vec<&'a str> {
        let of = of.iter().map(String::as_str);
        words.iter().copied().chain(of).collect()
    }
}

#[test]
fn metrics_move_with_what_the_aggregator_does() {
    let observed = Observed::serve(&[]);
    let of = observed.of_network();
    let head = observed.shown.get("/metrics");
    assert!(head.starts_with("HTTP/1.1 200"), "{head}");
    assert!(head.contains("application/openmetrics-text"), "{head}");
    assert!(head.ends_with("# EOF\n"), "{head}");
    assert!(observed.shown.get("/other").starts_with("HTTP/1.1 404"));

    let asked = r#"zk0_requests_total{method="GetGovernance",status="Ok"}"#;
    let seconds = r#"zk0_request_seconds_count{method="GetGovernance"}"#;
    assert_eq!(
        [observed.shown.metric(asked), observed.shown.metric(seconds)],
        [0.0, 0.0]
    );
    prints(&observed.asking(&["governance", "status"], &of));
    observed.shown.becomes(asked, 1.0);
    observed.shown.becomes(seconds, 1.0);

    // An enrolment is an entry of the ledger, which is appended in measured time.
    let entries = r#"zk0_ledger_entries{are="recorded"}"#;
    let before = observed.shown.metric(entries);
    assert_eq!(observed.shown.metric(r#"zk0_nodes{are="enrolled"}"#), 1.0);
    let (key, new) = (
        observed.network.path("log.key"),
        observed.network.path("new.key"),
    );
    let identity = prints(&["node", "keygen", &new]);
    let node = format!("new={}", identity.trim());
    let enrol = ["aggregator", "enrol", "--key", &key, "--node", &node];
    prints(&observed.asking(&enrol, &of));
    assert_eq!(observed.shown.metric(entries), before + 1.0);
    assert_eq!(observed.shown.metric(r#"zk0_nodes{are="enrolled"}"#), 2.0);
    assert_eq!(observed.shown.metric("zk0_append_seconds_count"), 1.0);
    assert_eq!(
        observed
            .shown
            .metric("zk0_certificate_ends_timestamp_seconds"),
        0.0
    );
    let held = observed.shown.metric("zk0_turn_held_seconds_count");
    assert!(held > 0.0 && observed.shown.metric("zk0_turn_waiting_seconds_count") >= held);

    // Whoever is connected counts. Whoever follows a round is a request in progress.
    let connections = "zk0_connections";
    observed.shown.becomes(connections, 0.0);
    let silent = TcpStream::connect(observed.address.trim_start_matches("http://")).unwrap();
    observed.shown.becomes(connections, 1.0);
    drop(silent);
    observed.shown.becomes(connections, 0.0);
    let watch = observed.asking(&["status", "--watch", "--json"], &of);
    let mut watching = zk0(&watch).stdout(Stdio::piped()).spawn().unwrap();
    let following = r#"zk0_requests_in_progress{method="WatchRound"}"#;
    observed.shown.becomes(following, 1.0);
    watching.kill().unwrap();
    watching.wait().unwrap();
    observed.shown.becomes(following, 0.0);
    observed.shown.becomes(
        r#"zk0_requests_total{method="WatchRound",status="Cancelled"}"#,
        1.0,
    );

    let shown = observed.shown.get("/metrics");
    for some in [
        "zk0_memory_bytes",
        "zk0_open_files",
        r#"zk0_disk_bytes{are="free"}"#,
    ] {
        assert!(observed.shown.metric(some) > 1.0, "{some}");
    }
    assert_eq!(
        observed.shown.metric(r#"zk0_round_phase{phase="waiting"}"#),
        1.0
    );
    let build = format!(
        "zk0_build_info{{version=\"{}\"}}",
        env!("CARGO_PKG_VERSION")
    );
    assert_eq!(observed.shown.metric(&build), 1.0);
    for kind in Kind::ALL {
        let none = format!("zk0_trouble{{kind=\"{}\"}} 0\n", kind.name());
        assert!(shown.contains(&none), "{none:?} is not in {shown}");
    }
}

#[test]
fn a_lost_file_is_trouble_with_an_exit_code_of_its_own() {
    let network = founded();
    let lost = network.genesis().initial.blob.to_string();
    let lost = Path::new(&network.path("ledger/blobs/sha256")).join(lost);
    let kept = network.path("kept");
    fs::rename(&lost, &kept).unwrap();
    let observed = Observed::serve_network(network, &["--min-nodes", "0"]);
    let of = observed.of_network();
    let blocked = r#"zk0_trouble{kind="blocked"}"#;
    observed.shown.becomes(blocked, 1.0);
    observed.shown.is_healthy(Some("cannot open or close"));
    let status = observed.asking(&["status"], &of);
    let reported = printed(&ends(TROUBLE, zk0(&status)));
    let line = reported.lines().find(|line| line.starts_with("trouble "));
    let line = line.unwrap_or_else(|| panic!("no trouble in {reported}"));
    assert!(
        line.contains("blocked, for ") && line.contains("cannot open"),
        "{line}"
    );
    let status_json = observed.asking(&["status", "--json"], &of);
    let status_json = printed(&ends(TROUBLE, zk0(&status_json)));
    let status_json: Value = serde_json::from_str(&status_json).unwrap();
    assert_eq!(status_json["trouble"][0]["kind"], "blocked");
    assert!(status_json["trouble"][0]["for_ms"].is_u64());

    fs::rename(&kept, &lost).unwrap();
    observed.shown.becomes(blocked, 0.0);
    observed.shown.is_healthy(None);
    assert!(!prints(&status).contains("trouble"));
}

/// An aggregator that publishes its log in this folder, as far as it has come.
fn publishing(folder: &Path) -> Observed {
    let address = format!("file://{}", folder.display());
    let observed = Observed::serve(&["--log-store", &address]);
    until("the log is published", || {
        folder.join("checkpoint").exists()
    });
    observed.shown.becomes("zk0_log_store_lag_entries", 0.0);
    observed
}

#[test]
fn a_log_store_with_another_log_is_a_fork() {
    let folders = [(); 2].map(|()| tempfile::tempdir().unwrap());
    let fork = r#"zk0_trouble{kind="fork"}"#;
    drop(publishing(folders[0].path()));
    let observed = publishing(folders[1].path());
    assert_eq!(observed.shown.metric(fork), 0.0);
    let [other, own] = folders.each_ref().map(|one| one.path().join("checkpoint"));
    fs::copy(other, own).unwrap();
    // With the next entry, the log is published again.
    let (key, new) = ["log.key", "new.key"]
        .map(|name| observed.network.path(name))
        .into();
    let node = format!("new={}", prints(&["node", "keygen", &new]).trim());
    let (enrol, of) = (
        ["aggregator", "enrol", "--key", &key, "--node", &node],
        observed.of_network(),
    );
    prints(&observed.asking(&enrol, &of));
    observed.shown.becomes(fork, 1.0);
    assert_eq!(observed.shown.metric("zk0_log_store_lag_entries"), 1.0);
    ends(TROUBLE, zk0(&observed.asking(&["status"], &of)));
}

#[test]
fn connections_that_a_limit_refuses_are_counted() {
    let observed = Observed::serve(&["--max-connections", "2"]);
    let connect = || TcpStream::connect(observed.address.trim_start_matches("http://")).unwrap();
    let _all = [connect(), connect(), connect()];
    observed
        .shown
        .becomes(r#"zk0_connections_lost_total{limit="made-room"}"#, 1.0);
    observed.shown.becomes("zk0_connections", 2.0);
}

#[test]
fn the_status_shows_rounds_nodes_the_ledger_and_the_disk() {
    let observed = Observed::serve(&["--rounds", "3", "--min-nodes", "2"]);
    let of = observed.of_network();
    let status = json(&observed.asking(&["status", "--json"], &of));
    let entries = observed.network.entries().len();
    for (key, value) in [
        ("phase", Value::from("waiting")),
        ("round", 0.into()),
        ("rounds", 3.into()),
        ("enrolled", 1.into()),
        ("ready", 0.into()),
        ("needed", 2.into()),
        ("entries", entries.into()),
        ("published", entries.into()),
        ("checkpoint", entries.into()),
        ("deadline_ms", Value::Null),
    ] {
        assert_eq!(status[key], value, "{key} of {status}");
    }
    assert!(
        status["disk_free_percent"].as_u64() <= Some(100),
        "{status}"
    );
    let text = prints(&observed.asking(&["status"], &of));
    for reported in [
        "waits for nodes",
        "1 enrolled, 0 ready; a round needs 2",
        "0 of 3 are over",
        "% free",
        "program      ",
    ] {
        assert!(text.contains(reported), "{reported:?} is not in {text}");
    }
    assert!(!text.contains("which this release lacks"), "{text}");
}

#[test]
fn the_age_of_the_last_backup_is_shown() {
    let observed = Observed::serve(&[]);
    let of = observed.of_network();
    assert_eq!(observed.shown.metric("zk0_backup_age_seconds"), -1.0);
    let none = prints(&observed.asking(&["status"], &of));
    assert!(none.contains("backup       none yet"), "{none}");

    let [ledger, out] = ["ledger", "saved"].map(|name| observed.network.path(name));
    prints(&["ledger", "backup", &ledger, &out]);
    assert_eq!(observed.shown.metric("zk0_backup_age_seconds"), 0.0);
    assert_eq!(observed.shown.metric("zk0_backup_lag_entries"), 0.0);
    let status = json(&observed.asking(&["status", "--json"], &of));
    assert_eq!(status["backup_entries"], status["entries"], "{status}");
    assert_eq!(status["backup_lacks_since_ms"], Value::Null, "{status}");
    // An old backup is as good while it lacks nothing.
    let entries = status["entries"].as_u64().unwrap();
    let recorded = Path::new(&ledger).join("backed-up");
    fs::write(&recorded, format!("1000 {entries}")).unwrap();
    assert_eq!(observed.shown.metric("zk0_backup_age_seconds"), 0.0);

    let [key, new] = ["log.key", "new.key"].map(|name| observed.network.path(name));
    let identity = prints(&["node", "keygen", &new]);
    let node = format!("new={}", identity.trim());
    let enrol = ["aggregator", "enrol", "--key", &key, "--node", &node];
    prints(&observed.asking(&enrol, &of));
    assert_eq!(observed.shown.metric("zk0_backup_lag_entries"), 1.0);
    let lacks = prints(&observed.asking(&["status"], &of));
    assert!(
        lacks.contains("old; the ledger has 1 entry that it lacks"),
        "{lacks}"
    );
    let status = json(&observed.asking(&["status", "--json"], &of));
    let (since, last) = (&status["backup_lacks_since_ms"], &status["last_entry_ms"]);
    assert_eq!(since, last, "{status}");
    // The backup itself is of 1970.
    let age = observed.shown.metric("zk0_backup_age_seconds");
    assert!((0.0..86_400.0).contains(&age), "{age}");
    // A ledger that lacks entries of its backup was rolled back.
    fs::write(&recorded, format!("1000 {}", entries + 3)).unwrap();
    assert_eq!(observed.shown.metric("zk0_backup_lag_entries"), -2.0);
    let rolled_back = prints(&observed.asking(&["status"], &of));
    let reported = "it has 2 entries that the ledger lacks: the ledger was rolled back";
    assert!(rolled_back.contains(reported), "{rolled_back}");
}

#[test]
fn a_watched_status_is_shown_again() {
    let observed = Observed::serve(&[]);
    let of = observed.of_network();
    let watch = observed.asking(&["status", "--watch", "--json"], &of);
    let mut watching = zk0(&watch).stdout(Stdio::piped()).spawn().unwrap();
    let lines = BufReader::new(watching.stdout.take().unwrap()).lines();
    let up: Vec<_> = lines
        .take(3)
        .map(|line| {
            let status: Value = serde_json::from_str(&line.unwrap()).unwrap();
            status["uptime_ms"].as_u64().unwrap()
        })
        .collect();
    assert!(up[0] < up[2], "{up:?}");
    // The reader has left, so the watch ends.
    let ended = until("the watch ends", || watching.try_wait().unwrap());
    assert!(ended.success(), "{ended:?}");
}

#[test]
fn the_status_of_another_network_is_refused() {
    let observed = Observed::serve(&[]);
    let other = "00".repeat(32);
    let ask = [
        "status",
        "--aggregator",
        &observed.address,
        "--network",
        &other,
    ];
    let refused = logged(&ends(1, zk0(&ask)));
    assert!(refused.contains("network"), "{refused}");
}
