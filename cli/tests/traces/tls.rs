//! The address of a collector: with TLS, without, and a wrong one.

use super::collector::{serving, Collector};
use crate::harness::network::LocalNetwork;
use crate::harness::serving::Serving;
use crate::harness::{fails, text, words};
use std::path::Path;
use tempfile::TempDir;
use zk0_service::tls::local_authority::{LocalAuthority, CA, CERTIFICATE, KEY};
use zk0_service::tls::server_certificate::ServerCertificate;

/// A folder with an authority, and with a certificate that it has signed.
fn certificates() -> TempDir {
    let dir = tempfile::tempdir().unwrap();
    let authority = LocalAuthority::new(&["127.0.0.1".into()]).unwrap();
    authority.write(dir.path()).unwrap();
    dir
}

fn founded() -> LocalNetwork {
    let network = LocalNetwork::new();
    network.found(&[]);
    network
}

fn at(dir: &TempDir, name: &str) -> String {
    text(&dir.path().join(name)).to_owned()
}

#[test]
fn traces_go_to_the_collector_that_shows_the_right_certificate() {
    let (ours, other) = (certificates(), certificates());
    let certificate = ServerCertificate::load(
        Path::new(&at(&ours, CERTIFICATE)),
        Path::new(&at(&ours, KEY)),
    );
    let collector = Collector::on("127.0.0.1:0", Some(certificate.unwrap()));
    let network = founded();
    let mut arguments = serving(&network, &collector.address);
    arguments.extend(["--otlp-ca".into(), at(&other, CA)]);
    let id = network.genesis().network_id().to_string();
    let often = [("OTEL_BSP_SCHEDULE_DELAY", "100")];
    let ask = |aggregator: &Serving| {
        let status = ["status", "--network", &id, "--aggregator"];
        crate::harness::prints(&[&status[..], &[&aggregator.address]].concat());
    };
    let mut aggregator = Serving::start_with(&words(&arguments), &often);
    ask(&aggregator);
    aggregator.logs("takes no traces");
    assert!(aggregator.terminate().success());
    assert!(collector.spans().0.is_empty());

    *arguments.last_mut().unwrap() = at(&ours, CA);
    let mut aggregator = Serving::start_with(&words(&arguments), &often);
    ask(&aggregator);
    collector.receives("zk0.v1.Federation/GetStatus");
    assert!(aggregator.terminate().success());
}

#[test]
fn a_wrong_address_is_refused_before_the_service_starts() {
    let network = founded();
    let refused = |collector: &str, more: &[&str]| {
        let arguments = serving(&network, collector);
        fails(&[&words(&arguments)[..], more].concat())
    };
    for address in ["nothing", "127.0.0.1:4317", "ftp://127.0.0.1:4317", ""] {
        let reported = refused(address, &[]);
        assert!(reported.contains("collector"), "{address}: {reported}");
    }
    let dir = certificates();
    let reported = refused("http://127.0.0.1:4317", &["--otlp-ca", &at(&dir, CA)]);
    assert!(reported.contains("use https://"), "{reported}");
    let reported = refused("https://127.0.0.1:4317", &["--otlp-ca", "/nothing.pem"]);
    assert!(reported.contains("/nothing.pem"), "{reported}");
}
