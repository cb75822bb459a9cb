//! The options for a service's certificate.

use anyhow::Result;
use std::net::SocketAddr;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;
use zk0_service::tls::server_certificate::ServerCertificate;

const LOOK_AGAIN: Duration = Duration::from_secs(5);

/// The certificate of a service.
#[derive(Clone, Debug, clap::Args)]
pub struct CertificateOptions {
    /// Encrypt with the certificate in this PEM file, which holds the server's certificate and then those that sign it. If the file changes,
    /// new connections are shown the new certificate.
    #[arg(long, value_name = "FILE", requires = "tls_key")]
    tls_certificate: Option<PathBuf>,
    /// The PEM file with the key of the certificate.
    #[arg(long, value_name = "FILE", requires = "tls_certificate")]
    tls_key: Option<PathBuf>,
}

impl CertificateOptions {
    /// The certificate, if connections are encrypted.
    pub fn load(&self) -> Result<Option<Arc<ServerCertificate>>> {
        match (&self.tls_certificate, &self.tls_key) {
            (Some(certificate), Some(key)) => Ok(Some(ServerCertificate::load(certificate, key)?)),
            _ => Ok(None),
        }
    }
}

/// Reads the certificate's files again and again. Without them, warns if other machines reach `address`.
pub fn keep_current(
    certificate: Option<&Arc<ServerCertificate>>,
    service: &str,
    address: SocketAddr,
) {
    match certificate {
        Some(certificate) => drop(tokio::spawn(certificate.clone().watch(LOOK_AGAIN))),
        None if address.ip().is_loopback() => {}
        None => tracing::warn!(
            "nothing that the {service} sends or receives is encrypted: use --tls-certificate, or put a TLS proxy before it"
        ),
    }
}

/// The scheme of a service's addresses.
pub fn scheme(certificate: Option<&Arc<ServerCertificate>>) -> &'static str {
    match certificate {
        Some(_) => "https",
        None => "http",
    }
}
