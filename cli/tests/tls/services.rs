//! The other services show certificates, too, and their clients believe the right ones: logs and their readers, witnesses and the aggregator, the
//! proving service and nodes.

use super::encrypted::Certificates;
use crate::harness::network::LocalNetwork;
use crate::harness::process::Process;
use crate::harness::serving::Serving;
use crate::harness::{ends, fails, logged, printed, prints, text, zk0, LEDGER, RECORDING};
use std::fs;
use std::net::TcpStream;
use std::path::{Path, PathBuf};
use std::time::Duration;
use tempfile::TempDir;
use tokio::runtime::Runtime;
use zk0_prover::service::ProvingClient;
use zk0_service::tls::local_authority::{CA, CERTIFICATE, KEY};
use zk0_testkit::until;

/// An authority with a server's certificate, as the binary makes them.
struct Made(TempDir);

impl Made {
    fn new() -> Self {
        let dir = tempfile::tempdir().unwrap();
        let folder = text(dir.path());
        prints(&["aggregator", "certificate", folder, "--name", "127.0.0.1"]);
        Self(dir)
    }

    fn path(&self, name: &str) -> String {
        text(&self.0.path().join(name)).to_owned()
    }

    /// Serves `arguments` on a free port, with the certificate.
    fn serve(&self, arguments: &[&str]) -> Serving {
        let (certificate, key) = (self.path(CERTIFICATE), self.path(KEY));
        let tls = ["--tls-certificate", &certificate, "--tls-key", &key];
        let listen = ["--listen", "127.0.0.1:0"];
        let mut serving = Serving::start(&[arguments, &listen, &tls].concat());
        serving.address = serving.address.replace("http://", "https://");
        serving
    }

    /// Puts the certificate of `other` in the place of this one.
    fn renew_by(&self, other: &Self) {
        for name in [CERTIFICATE, KEY] {
            fs::copy(other.path(name), self.path(name)).unwrap();
        }
    }
}

#[track_caller]
fn reports(message: &str, words: &[&str]) {
    for word in words {
        assert!(message.contains(word), "{word:?} is not in {message:?}");
    }
}

#[test]
fn a_log_is_served_and_read_over_tls() {
    let (made, other) = (Made::new(), Made::new());
    let served = made.serve(&["ledger", "serve", LEDGER]);
    let (ca, others) = (made.path(CA), other.path(CA));
    let vkey = ["ledger", "vkey", &served.address];
    let shown = prints(&[&vkey[..], &["--ca", &ca]].concat());
    assert_eq!(shown, prints(&["ledger", "vkey", LEDGER]));
    // Without --ca, the authorities of the system count.
    let mut command = zk0(&vkey);
    command.env("SSL_CERT_FILE", &ca);
    assert_eq!(printed(&ends(0, command)), shown);
    reports(&fails(&vkey), &["not signed by an authority", "--ca"]);
    let refused = fails(&[&vkey[..], &["--ca", &others]].concat());
    reports(&refused, &["not signed by a certificate in", &others]);
    let http = served.address.replace("https://", "http://");
    let refused = fails(&["ledger", "vkey", &http]);
    reports(&refused, &["status 400", "use https://"]);

    let plain = Serving::start(&["ledger", "serve", LEDGER, "--listen", "127.0.0.1:0"]);
    let https = plain.address.replace("http://", "https://");
    let refused = fails(&["ledger", "vkey", &https, "--ca", &ca]);
    reports(&refused, &["does not speak TLS"]);

    made.renew_by(&other);
    served.logs("new certificate");
    prints(&[&vkey[..], &["--ca", &others]].concat());
    let refused = fails(&[&vkey[..], &["--ca", &ca]].concat());
    reports(&refused, &["not signed by a certificate in"]);
}

/// The aggregator, and whoever reads a witness' last checkpoint.
#[test]
fn witnesses_are_asked_over_tls() {
    let network = LocalNetwork::new();
    network.found(&[]);
    let (ledger, key) = (network.path("ledger"), network.path("log.key"));
    let (made, other) = (Made::new(), Made::new());
    let (secret, name) = (network.path("w.key"), "witness.example/w");
    let witness = prints(&["witness", "keygen", &secret, "--name", name]);
    let (folder, log) = (
        network.path("witness"),
        prints(&["ledger", "vkey", &ledger]),
    );
    let mut served = vec!["witness", "serve", &folder, "--key", &secret];
    served.extend(["--name", name, "--log-key", log.trim()]);
    let served = made.serve(&served);
    let policy = network.path("policy");
    let named = |address: &str| {
        let line = format!("witness W {} {address}\nquorum W\n", witness.trim());
        fs::write(&policy, line).unwrap();
    };
    named(&served.address);
    let asking = ["aggregator", "serve", &ledger, "--key", &key];
    let asking = [&asking[..], &["--listen", "127.0.0.1:0"]].concat();
    let asking = [&asking[..], &["--witness-policy", &policy]].concat();
    let with = |ca: &str| Serving::start(&[&asking[..], &["--witness-ca", ca]].concat());

    let (ca, others) = (made.path(CA), other.path(CA));
    // The aggregator signs nothing before a witness has answered it.
    let unanswered = |more: &[&str], why: &[&str]| {
        let asking: Vec<_> = asking.iter().chain(more).map(ToString::to_string).collect();
        let begins = ["witness W cannot be asked", "witness W refuses"];
        let line = Process::start(&asking).says_one_of(&begins);
        reports(line["message"].as_str().unwrap(), why);
    };
    let others_sign = ["its certificate is not signed by a certificate in"];
    unanswered(&["--witness-ca", &others], &others_sign);
    // The system's authorities have not signed the certificate, either.
    let untrusted = "its certificate is not signed by an authority that this machine trusts";
    unanswered(&[], &[untrusted, "--witness-ca"]);
    // With authorities, nothing is sent that is not encrypted.
    named(&served.address.replace("https://", "http://"));
    let plain = fails(&[&asking[..], &["--witness-ca", &ca]].concat());
    reports(&plain, &["witness W", "use https:// in the witness policy"]);
    unanswered(&[], &["this port speaks TLS: use https://"]);
    named(&served.address);
    let mut cosigned = with(&ca);
    cosigned.logs("checkpoint cosigned and published");
    assert!(cosigned.terminate().success());

    made.renew_by(&other);
    served.logs("new certificate");
    // A new checkpoint: another node is enrolled.
    let identity = prints(&["node", "keygen", &network.path("second.key")]);
    let node = format!("second={}", identity.trim());
    prints(&[
        "aggregator",
        "enrol",
        &ledger,
        "--key",
        &key,
        "--node",
        &node,
    ]);
    unanswered(&["--witness-ca", &ca], &others_sign);
    with(&others).logs("checkpoint cosigned and published");
}

#[test]
fn a_proving_service_shows_its_certificate() {
    let (certificates, other) = (Certificates::new(), Certificates::new());
    let network = LocalNetwork::new();
    let certificate = certificates.load();
    let served = network.prover_with(Some(certificate.clone()));
    let runtime = Runtime::new().unwrap();
    let connect = |url: &str, ca: Option<PathBuf>| {
        let address = ProvingClient::address(url.to_owned()).with_ca(ca);
        let connected = runtime.block_on(ProvingClient::connect(address));
        connected.map(drop).map_err(|error| error.to_string())
    };
    connect(&served.address, certificates.ca()).unwrap();
    let refused = connect(&served.address, other.ca()).unwrap_err();
    reports(
        &refused,
        &[
            "the proving service at https://",
            "not signed by a certificate in",
        ],
    );
    let refused = connect(&served.address, None).unwrap_err();
    reports(&refused, &["not signed by an authority", "--prover-ca"]);
    let http = served.address.replace("https://", "http://");
    reports(&connect(&http, None).unwrap_err(), &["use https://"]);

    runtime.spawn(certificate.watch(Duration::from_millis(50)));
    for name in [CERTIFICATE, KEY] {
        fs::copy(other.path(name), certificates.path(name)).unwrap();
    }
    until("the new certificate is shown", || {
        connect(&served.address, other.ca()).is_ok()
    });
    let refused = connect(&served.address, certificates.ca()).unwrap_err();
    reports(&refused, &["not signed by a certificate in"]);

    // Whoever is silent in the handshake keeps nobody waiting.
    let address = served.address.trim_start_matches("https://");
    let _silent: Vec<_> = (0..20)
        .map(|_| TcpStream::connect(address).unwrap())
        .collect();
    connect(&served.address, other.ca()).unwrap();
}

/// The binary reads the certificate before SP1 starts.
#[test]
fn a_proving_service_does_not_start_without_its_certificate() {
    let missing = [
        "--tls-certificate",
        "missing.pem",
        "--tls-key",
        "missing.key",
    ];
    let reported = fails(
        &[
            &["prover", "serve", "--listen", "127.0.0.1:0"],
            &missing[..],
        ]
        .concat(),
    );
    reports(&reported, &["reading missing.pem"]);
}

#[test]
fn a_node_believes_only_the_proving_service_of_its_authority() {
    let network = LocalNetwork::new();
    network.found_with_short_rounds();
    let (certificates, other) = (Certificates::new(), Certificates::new());
    let encrypted = network.prover_with(Some(certificates.load()));
    let (key, state) = (network.path("node.key"), network.path("state"));
    network.served(|aggregator, plain, id| {
        let join = |prover: &str, ca: Option<&Path>| {
            let mut arguments = vec!["node", "join", "--aggregator", aggregator];
            arguments.extend(["--prover", prover]);
            arguments.extend(ca.iter().flat_map(|ca| ["--prover-ca", text(ca)]));
            arguments.extend(["--network", id, "--key", &key, "--dataset", RECORDING]);
            arguments.extend(["--state", &state, "--steps", "1", "--batch-size", "1"]);
            zk0(&arguments).output().unwrap()
        };
        let (ca, others) = (certificates.path(CA), other.path(CA));
        let https = plain.replace("http://", "https://");
        for (prover, ca, words) in [
            (&*encrypted.address, Some(&*others), "not signed by"),
            (&https, Some(&ca), "does not speak TLS"),
            (plain, Some(&ca), "use https://"),
            (aggregator, None, "is not a proving service"),
        ] {
            let refused = join(prover, ca);
            assert!(!refused.status.success(), "{prover}");
            reports(&logged(&refused), &["the proving service at", words]);
        }
        let joined = join(&encrypted.address, Some(&ca));
        assert!(joined.status.success(), "{}", logged(&joined));
    });
}
