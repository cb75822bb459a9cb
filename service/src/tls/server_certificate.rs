//! A server's certificate, from PEM files. It is read again while the server runs, so that renewal needs no restart.

use rustls::client::verify_server_cert_signed_by_trust_anchor;
use rustls::crypto::{ring, CryptoProvider};
use rustls::pki_types::pem::PemObject;
use rustls::pki_types::{CertificateDer, PrivateKeyDer, UnixTime};
use rustls::server::{ClientHello, ParsedCertificate, ResolvesServerCert};
use rustls::sign::CertifiedKey;
use rustls::{Error, RootCertStore, ServerConfig};
use std::io;
use std::path::{Path, PathBuf};
use std::sync::{Arc, PoisonError, RwLock};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpStream;
use tokio::task::spawn_blocking;
use tokio::time::sleep;
use tokio_rustls::server::TlsStream;
use tokio_rustls::TlsAcceptor;
use zk0_files::bounded_file;

/// Largest certificate or key file read.
const MAX_FILE_BYTES: u64 = 1 << 20;

/// A day, in seconds.
const DAY_S: i64 = 86_400;

/// How long before its end the log warns. Public authorities sign for 90 days; tools renew a month before the end.
const WARN_BEFORE_S: i64 = 21 * DAY_S;

/// How often it warns.
const WARN_AGAIN: Duration = Duration::from_secs(DAY_S as u64);

/// The first byte of a TLS handshake.
const HANDSHAKE: u8 = 22;

/// The answer to HTTP without TLS.
const NOT_TLS: &[u8] = b"HTTP/1.1 400 Bad Request\r\nconnection: close\r\n\
    content-type: text/plain; charset=utf-8\r\n\r\nthis port speaks TLS: use https://\n";

/// Why a certificate is unusable.
#[derive(Debug, thiserror::Error)]
pub enum CertificateError {
    /// A file is unreadable.
    #[error("reading {}: {error}", .path.display())]
    Read { path: PathBuf, error: io::Error },
    /// The file has no certificate.
    #[error("{} holds no certificate: it has to be a PEM file that begins with the server's certificate", .0.display())]
    NoCertificate(PathBuf),
    /// The file has no key.
    #[error("{} holds no private key: it has to be a PEM file with the key of the certificate", .0.display())]
    NoKey(PathBuf),
    /// They do not belong together, or the key's kind is unknown.
    #[error("the certificate in {} cannot be used with the key in {}: {error}", .certificate.display(), .key.display())]
    Unusable {
        certificate: PathBuf,
        key: PathBuf,
        error: rustls::Error,
    },
}

/// A server's certificate with its key.
#[derive(Debug)]
pub struct ServerCertificate {
    certificate: PathBuf,
    key: PathBuf,
    shown: RwLock<Shown>,
}

#[derive(Debug)]
struct Shown {
    /// The files' content at the last read.
    read: [Vec<u8>; 2],
    certified: Arc<CertifiedKey>,
    /// The certificate's end, in Unix seconds.
    ends_s: i64,
}

/// Encrypts a server's connections.
#[derive(Clone)]
pub struct Acceptor(TlsAcceptor);

impl ServerCertificate {
    /// Reads the certificate, followed by its signers', and its key.
    pub fn load(certificate: &Path, key: &Path) -> Result<Arc<Self>, CertificateError> {
        let read = read(certificate, key)?;
        let (certified, ends_s) = parse(certificate, key, &read)?;
        Ok(Arc::new(Self {
            certificate: certificate.into(),
            key: key.into(),
            shown: RwLock::new(Shown {
                read,
                certified,
                ends_s,
            }),
        }))
    }

    /// The current certificate's end, in Unix seconds.
    pub fn ends_s(&self) -> i64 {
        let shown = self.shown.read().unwrap_or_else(PoisonError::into_inner);
        shown.ends_s
    }

    /// Logs that the certificate ends soon or has ended, which stops clients.
    fn warn_of_its_end(&self) {
        let now = SystemTime::now().duration_since(UNIX_EPOCH);
        let now_s = now.map_or(0, |now| now.as_secs() as i64);
        let (path, left_s) = (self.certificate.display(), self.ends_s() - now_s);
        if left_s <= 0 {
            tracing::error!(
                "the certificate in {path} has ended, so clients do not connect: renew it"
            );
        } else if left_s < WARN_BEFORE_S {
            let days = left_s / DAY_S;
            tracing::warn!("the certificate in {path} ends in {days} days: renew it");
        }
    }

    /// Reads the files again; returns whether the certificate is new. A broken file is an error once, and the old certificate stays.
    fn reload(&self) -> Result<bool, CertificateError> {
        let read = read(&self.certificate, &self.key)?;
        let mut shown = self.shown.write().unwrap_or_else(PoisonError::into_inner);
        if shown.read == read {
            return Ok(false);
        }
        let parsed = parse(&self.certificate, &self.key, &read);
        shown.read = read;
        (shown.certified, shown.ends_s) = parsed?;
        Ok(true)
    }

    /// Reads the files repeatedly. Later connections see a new certificate. Before a certificate ends, logs a warning each day.
    pub async fn watch(self: Arc<Self>, every: Duration) {
        let mut reported = String::new();
        let mut warned: Option<Instant> = None;
        loop {
            sleep(every).await;
            if warned.is_none_or(|at| at.elapsed() >= WARN_AGAIN) {
                self.warn_of_its_end();
                warned = Some(Instant::now());
            }
            let certificate = self.clone();
            let reloaded = match spawn_blocking(move || certificate.reload()).await {
                Ok(reloaded) => reloaded,
                Err(_) => return,
            };
            match reloaded {
                Ok(false) => {}
                Ok(true) => {
                    let path = self.certificate.display();
                    tracing::info!("new connections are shown the new certificate in {path}");
                    reported.clear();
                    warned = None;
                }
                Err(error) => {
                    let why = error.to_string();
                    if reported != why {
                        tracing::error!("{why}; the old certificate stays");
                        reported = why;
                    }
                }
            }
        }
    }

    /// Encrypts connections with this certificate, for clients of `protocol` (its ALPN name: `h2` or `http/1.1`).
    pub fn acceptor(self: &Arc<Self>, protocol: &str) -> Acceptor {
        let mut config = ServerConfig::builder_with_provider(provider())
            .with_safe_default_protocol_versions()
            .expect("the provider has the ciphers of TLS 1.2 and 1.3")
            .with_no_client_auth()
            .with_cert_resolver(self.clone());
        config.alpn_protocols = vec![protocol.as_bytes().to_vec()];
        Acceptor(Arc::new(config).into())
    }
}

impl ResolvesServerCert for ServerCertificate {
    fn resolve(&self, _: ClientHello<'_>) -> Option<Arc<CertifiedKey>> {
        let shown = self.shown.read().unwrap_or_else(PoisonError::into_inner);
        Some(shown.certified.clone())
    }
}

impl Acceptor {
    /// The TLS handshake. Tells clients without TLS to use it.
    pub async fn accept(&self, mut stream: TcpStream) -> io::Result<TlsStream<TcpStream>> {
        let mut first = [0];
        if stream.peek(&mut first).await? == 1 && first != [HANDSHAKE] {
            // Reads first: with unread input at the end, the system discards the answer.
            let _ = stream.read(&mut [0; 4096]).await?;
            stream.write_all(NOT_TLS).await?;
            stream.shutdown().await?;
            return Err(io::Error::other("the client does not speak TLS"));
        }
        self.0.accept(stream).await
    }
}

fn provider() -> Arc<CryptoProvider> {
    Arc::new(ring::default_provider())
}

fn read(certificate: &Path, key: &Path) -> Result<[Vec<u8>; 2], CertificateError> {
    let read = |path: &Path| {
        bounded_file::read(path, MAX_FILE_BYTES).map_err(|error| CertificateError::Read {
            path: path.into(),
            error,
        })
    };
    Ok([read(certificate)?, read(key)?])
}

fn parse(
    certificate: &Path,
    key: &Path,
    [chain, secret]: &[Vec<u8>; 2],
) -> Result<(Arc<CertifiedKey>, i64), CertificateError> {
    let chain: Vec<_> = CertificateDer::pem_slice_iter(chain)
        .collect::<Result<_, _>>()
        .map_err(|_| CertificateError::NoCertificate(certificate.into()))?;
    let ends_s = chain.first().and_then(end_of);
    let Some(ends_s) = ends_s else {
        return Err(CertificateError::NoCertificate(certificate.into()));
    };
    let secret = PrivateKeyDer::from_pem_slice(secret);
    let secret = secret.map_err(|_| CertificateError::NoKey(key.into()))?;
    let certified = CertifiedKey::from_der(chain, secret, &ring::default_provider());
    let certified = certified.map_err(|error| CertificateError::Unusable {
        certificate: certificate.into(),
        key: key.into(),
        error,
    })?;
    Ok((Arc::new(certified), ends_s))
}

/// A certificate's end, in Unix seconds: rustls' verifier tells it when asked about a later time.
fn end_of(certificate: &CertificateDer<'_>) -> Option<i64> {
    let after_all = UnixTime::since_unix_epoch(Duration::from_secs(1 << 40));
    let parsed = ParsedCertificate::try_from(certificate).ok()?;
    let verified = verify_server_cert_signed_by_trust_anchor(
        &parsed,
        &RootCertStore::empty(),
        &[],
        after_all,
        provider().signature_verification_algorithms.all,
    );
    match verified {
        Err(Error::InvalidCertificate(rustls::CertificateError::ExpiredContext {
            not_after,
            ..
        })) => i64::try_from(not_after.as_secs()).ok(),
        _ => None,
    }
}
