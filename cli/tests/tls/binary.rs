//! The binary makes a certificate, serves with it, connects by it, and ends in time.

use crate::harness::network::LocalNetwork;
use crate::harness::serving::Serving;
use crate::harness::{ends, fails, logged, printed, prints, zk0};
use rcgen::CertificateParams;
use std::io::{Read, Write};
use std::net::TcpStream;
use std::path::Path;
use std::time::{Duration, Instant, SystemTime};
use zk0_service::tls::local_authority::LocalAuthority;

#[test]
fn a_network_is_served_and_reached_over_tls() {
    let network = LocalNetwork::new();
    network.found(&[]);
    let tls = network.path("tls");
    let made = prints(&["aggregator", "certificate", &tls, "--name", "127.0.0.1"]);
    assert!(made.contains("--tls-certificate"), "{made}");
    // The same authority signs again, for the same server or for another one.
    let again = prints(&["aggregator", "certificate", &tls, "--name", "127.0.0.1"]);
    assert!(again.contains("signed the new certificate"), "{again}");
    let other = network.path("other");
    let unusable = fails(&["aggregator", "certificate", &other, "--name", "bad name"]);
    assert!(unusable.contains("neither a host name"), "{unusable}");
    assert!(!Path::new(&other).exists());

    let (ledger, key) = (network.path("ledger"), network.path("log.key"));
    let [ca, certificate, secret] =
        ["ca.pem", "server.pem", "server.key"].map(|name| network.path(&format!("tls/{name}")));
    let mut arguments = vec!["aggregator", "serve", &ledger, "--key", &key];
    arguments.extend(["--listen", "127.0.0.1:0", "--drain-seconds", "1"]);
    arguments.extend(["--tls-certificate", &certificate, "--tls-key", &secret]);
    let mut serving = Serving::start(&arguments);

    let id = network.genesis().network_id().to_string();
    let plain = serving.address.clone();
    let encrypted = plain.replace("http://", "https://");
    let status = |address| {
        [
            "governance",
            "status",
            "--network",
            &id,
            "--aggregator",
            address,
        ]
    };
    let shown = prints(&[&status(&encrypted)[..], &["--ca", &ca]].concat());
    assert!(shown.contains("program"), "{shown}");
    // Without --ca, the authorities of the system count.
    let mut command = zk0(&status(&encrypted));
    command.env("SSL_CERT_FILE", &ca);
    assert_eq!(printed(&ends(0, command)), shown);
    let refused = fails(&status(&encrypted));
    assert!(refused.contains("not signed by"), "{refused}");
    let refused = fails(&status(&plain));
    assert!(refused.contains("use https://"), "{refused}");

    // Whoever speaks plain HTTP to the port hears why that does not work.
    let mut stream = TcpStream::connect(plain.strip_prefix("http://").unwrap()).unwrap();
    stream.write_all(b"GET / HTTP/1.1\r\n\r\n").unwrap();
    let mut answer = String::new();
    stream.read_to_string(&mut answer).unwrap();
    assert!(answer.contains("this port speaks TLS"), "{answer}");

    // A peer that is silent does not keep the process.
    let _silent = TcpStream::connect(plain.strip_prefix("http://").unwrap()).unwrap();
    let begun = Instant::now();
    assert!(serving.terminate().success());
    // A handshake may take ten seconds.
    assert!(begun.elapsed() < Duration::from_secs(8));
}

#[test]
fn the_log_warns_of_a_certificate_that_ends_soon() {
    let network = LocalNetwork::new();
    network.found(&[]);
    let soon = SystemTime::now() + Duration::from_secs(20 * 86_400 + 3_600);
    let ends = |params: &mut CertificateParams| params.not_after = soon.into();
    let authority = LocalAuthority::with(&["127.0.0.1".into()], ends).unwrap();
    authority.write(Path::new(&network.path("tls"))).unwrap();
    let [ledger, key, certificate, secret] =
        ["ledger", "log.key", "tls/server.pem", "tls/server.key"].map(|name| network.path(name));
    let mut arguments = vec!["aggregator", "serve", &ledger, "--key", &key];
    arguments.extend(["--listen", "127.0.0.1:0"]);
    arguments.extend(["--tls-certificate", &certificate, "--tls-key", &secret]);
    let serving = Serving::start(&arguments);
    serving.logs("ends in 20 days: renew it");
}

#[test]
fn a_certificate_comes_with_its_key() {
    let output = ends(
        2,
        zk0(&["aggregator", "serve", "x", "--key", "x", "--tls-key", "x"]),
    );
    assert!(logged(&output).contains("--tls-certificate"));
}
