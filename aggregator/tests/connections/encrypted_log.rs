//! The log's files are served over TLS with the aggregator's certificate.

use crate::Test;
use std::future::pending;
use std::path::{Path, PathBuf};
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::{TcpListener, TcpStream};
use tokio::task::spawn_blocking;
use zk0_aggregator::publish::http::{self, HttpLimits};
use zk0_aggregator::publish::log_server::LogServer;
use zk0_ledger::published::source::LogSource;
use zk0_ledger::published::web::Web;
use zk0_service::tls::local_authority::{LocalAuthority, CA, CERTIFICATE, KEY};
use zk0_service::tls::server_certificate::ServerCertificate;
use zk0_testkit::aggregator::REAL;

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
        let limits = HttpLimits::default();
        let router = LogServer::new(Path::new(REAL)).router(limits);
        http::serve_with(listener, router, limits, Some(&certificate), pending()).await;
    });

    let url = format!("https://{address}");
    let read = async |ca: Option<PathBuf>| {
        let url = url.clone();
        let read = move || Web::at(&url, ca.as_deref())?.get("checkpoint", 10_000);
        spawn_blocking(read).await.unwrap()
    };
    let checkpoint = read(Some(dir.path().join(CA))).await?;
    assert!(checkpoint.is_some());
    // Public authorities have not signed this certificate, and neither has another one of a network's own.
    let other = tempfile::tempdir()?;
    LocalAuthority::new(&["127.0.0.1".into()])?.write(other.path())?;
    for ca in [None, Some(other.path().join(CA))] {
        let error = read(ca).await.unwrap_err().to_string();
        assert!(error.contains("certificate"), "{error}");
    }
    let no_authority = read(Some(dir.path().join(KEY))).await.unwrap_err();
    assert!(
        no_authority
            .to_string()
            .contains("not a PEM file with certificates"),
        "{no_authority}"
    );
    let http = format!("http://{address}");
    let error = Web::at(&http, Some(&dir.path().join(CA))).map(drop);
    assert!(error.unwrap_err().to_string().contains("use https://"));

    let mut plain = TcpStream::connect(address).await?;
    plain.write_all(REQUEST).await?;
    let mut answer = String::new();
    plain.read_to_string(&mut answer).await?;
    assert!(answer.starts_with("HTTP/1.1 400"), "{answer}");
    assert!(answer.contains("use https://"), "{answer}");
    Ok(())
}
