//! The log's files are served over TLS with the aggregator's certificate.

use crate::harness::REAL;
use crate::Test;
use rustls::crypto::ring;
use rustls::pki_types::pem::PemObject;
use rustls::pki_types::{CertificateDer, ServerName};
use rustls::{ClientConfig, RootCertStore};
use std::future::pending;
use std::path::Path;
use std::sync::Arc;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::{TcpListener, TcpStream};
use tokio_rustls::TlsConnector;
use zk0_aggregator::publish::http::{self, Limits};
use zk0_aggregator::publish::log_server::LogServer;
use zk0_aggregator::tls::local_authority::{LocalAuthority, CERTIFICATE, KEY};
use zk0_aggregator::tls::server_certificate::ServerCertificate;

const REQUEST: &[u8] = b"GET /checkpoint HTTP/1.1\r\nhost: x\r\nconnection: close\r\n\r\n";

#[tokio::test(flavor = "multi_thread")]
async fn a_log_is_read_over_tls_and_not_without() -> Test {
    let dir = tempfile::tempdir()?;
    let authority = LocalAuthority::new(&["127.0.0.1".into()])?;
    authority.write(dir.path())?;
    let [certificate, key] = [CERTIFICATE, KEY].map(|name| dir.path().join(name));
    let certificate = ServerCertificate::load(&certificate, &key)?;
    let listener = TcpListener::bind("127.0.0.1:0").await?;
    let address = listener.local_addr()?;
    tokio::spawn(async move {
        let limits = Limits::default();
        let router = LogServer::new(Path::new(REAL)).router(limits);
        http::serve_encrypted(listener, router, limits, &certificate, pending()).await;
    });

    let mut roots = RootCertStore::empty();
    roots.add(CertificateDer::from_pem_slice(authority.ca.as_bytes())?)?;
    let config = ClientConfig::builder_with_provider(Arc::new(ring::default_provider()))
        .with_safe_default_protocol_versions()?
        .with_root_certificates(roots)
        .with_no_client_auth();
    let stream = TcpStream::connect(address).await?;
    let name = ServerName::IpAddress(address.ip().into());
    let mut stream = TlsConnector::from(Arc::new(config))
        .connect(name, stream)
        .await?;
    stream.write_all(REQUEST).await?;
    let mut answer = String::new();
    stream.read_to_string(&mut answer).await?;
    assert!(answer.starts_with("HTTP/1.1 200"), "{answer}");

    let mut plain = TcpStream::connect(address).await?;
    plain.write_all(REQUEST).await?;
    let mut answer = String::new();
    plain.read_to_string(&mut answer).await?;
    assert!(answer.starts_with("HTTP/1.1 400"), "{answer}");
    assert!(answer.contains("use https://"), "{answer}");
    Ok(())
}
