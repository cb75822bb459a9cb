//! Which certificates a node believes, and what it states of the others.

use super::encrypted::{Certificates, Encrypted, HANDSHAKE};
use rcgen::date_time_ymd;
use std::fs;
use std::path::Path;
use std::time::{Duration, Instant};
use tokio::io::AsyncReadExt;
use tokio::net::TcpStream;
use tokio::time::timeout;
use zk0_service::tls::local_authority::{LocalAuthority, CERTIFICATE, KEY};
use zk0_service::tls::server_certificate::ServerCertificate;

fn names(names: &[&str]) -> Vec<String> {
    names.iter().map(|name| (*name).to_owned()).collect()
}

#[track_caller]
fn reports(message: &str, words: &[&str]) {
    for word in words {
        assert!(message.contains(word), "{word:?} is not in {message:?}");
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_node_speaks_to_an_aggregator_with_the_right_certificate() {
    let certificates = Certificates::new();
    let served = Encrypted::serve(Some(certificates.load())).await;
    let mut node = served.connect("https", certificates.ca()).await.unwrap();
    node.governance().await.unwrap();
}

#[tokio::test(flavor = "multi_thread")]
async fn the_certificate_of_another_authority_is_refused() {
    let (certificates, other) = (Certificates::new(), Certificates::new());
    let served = Encrypted::serve(Some(certificates.load())).await;
    let message = served.refused("https", other.ca()).await;
    reports(&message, &[&served.address, "not signed by", "ca.pem"]);
    // The authorities that the system trusts did not sign it, either.
    let message = served.refused("https", None).await;
    reports(&message, &["not signed by", "--ca"]);
}

#[tokio::test(flavor = "multi_thread")]
async fn an_expired_certificate_is_refused() {
    let authority = LocalAuthority::with(&names(&["127.0.0.1"]), |params| {
        params.not_after = date_time_ymd(2020, 1, 1);
    });
    let certificates = Certificates::of(&authority.unwrap());
    let served = Encrypted::serve(Some(certificates.load())).await;
    let message = served.refused("https", certificates.ca()).await;
    reports(&message, &["not valid now", "expired"]);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_certificate_for_another_name_is_refused() {
    let authority = LocalAuthority::new(&names(&["other.example", "192.0.2.1"])).unwrap();
    let certificates = Certificates::of(&authority);
    let served = Encrypted::serve(Some(certificates.load())).await;
    let message = served.refused("https", certificates.ca()).await;
    reports(&message, &["another name", "127.0.0.1", "other.example"]);
}

#[tokio::test(flavor = "multi_thread")]
async fn plain_http_and_tls_are_told_apart() {
    let certificates = Certificates::new();
    let encrypted = Encrypted::serve(Some(certificates.load())).await;
    reports(&encrypted.refused("http", None).await, &["use https://"]);
    let plain = Encrypted::serve(None).await;
    let message = plain.refused("https", certificates.ca()).await;
    reports(&message, &["does not speak TLS"]);
    // With an authority, a node sends nothing that is not encrypted.
    let message = plain.refused("http", certificates.ca()).await;
    reports(&message, &["use https://"]);
    plain.connect("http", None).await.unwrap();
}

#[tokio::test(flavor = "multi_thread")]
async fn a_file_of_authorities_has_to_hold_some() {
    let certificates = Certificates::new();
    let served = Encrypted::serve(Some(certificates.load())).await;
    let missing = certificates.path("missing.pem");
    reports(
        &served.refused("https", Some(missing)).await,
        &["missing.pem"],
    );
    let key = certificates.path(KEY);
    let message = served.refused("https", Some(key)).await;
    reports(
        &message,
        &["server.key", "not a PEM file with certificates"],
    );
}

#[test]
fn a_certificate_and_a_key_have_to_belong_together() {
    let (certificates, other) = (Certificates::new(), Certificates::new());
    let load = |certificate: &Path, key: &Path| {
        let error = ServerCertificate::load(certificate, key).unwrap_err();
        error.to_string()
    };
    let (certificate, key) = (certificates.path(CERTIFICATE), certificates.path(KEY));
    reports(
        &load(&certificate, &other.path(KEY)),
        &["cannot be used with"],
    );
    reports(&load(&key, &key), &["holds no certificate"]);
    reports(&load(&certificate, &certificate), &["holds no private key"]);
    fs::remove_file(&certificate).unwrap();
    reports(&load(&certificate, &key), &["reading", "server.pem"]);
}

#[tokio::test(flavor = "multi_thread")]
async fn whoever_does_not_finish_the_handshake_is_closed_and_keeps_nobody_waiting() {
    let certificates = Certificates::new();
    let served = Encrypted::serve(Some(certificates.load())).await;
    let mut silent = TcpStream::connect(&served.address).await.unwrap();
    let begun = Instant::now();
    served.connect("https", certificates.ca()).await.unwrap();
    assert!(begun.elapsed() < HANDSHAKE / 2);
    let mut buffer = [0; 10];
    let read = timeout(Duration::from_secs(20), silent.read(&mut buffer));
    assert_eq!(read.await.unwrap().unwrap_or(0), 0);
}
