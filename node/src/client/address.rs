//! Where an aggregator is, and whose certificates count there.

use crate::client_error::NodeError;
use rustls::pki_types::pem::PemObject;
use rustls::pki_types::CertificateDer;
use rustls::{AlertDescription, CertificateError, RootCertStore};
use std::error::Error;
use std::io;
use std::net::IpAddr;
use std::path::{Path, PathBuf};
use std::time::Duration;
use tonic::transport::{Channel, ClientTlsConfig, Endpoint};
use zk0_files::bounded_file;

/// Largest file of certificates that is read.
const MAX_CA_BYTES: u64 = 1 << 20;

/// How long a connection, with its TLS handshake, may take.
const PATIENCE: Duration = Duration::from_secs(10);

/// The address of an aggregator, `https://…` or `http://…`.
#[derive(Clone, Debug)]
pub struct AggregatorAddress {
    url: String,
    /// The certificates that sign the aggregator's; by default those that the system trusts.
    ca: Option<PathBuf>,
}

impl From<String> for AggregatorAddress {
    fn from(url: String) -> Self {
        Self { url, ca: None }
    }
}

impl AggregatorAddress {
    /// From now on, only the certificates in this PEM file count.
    pub fn with_ca(mut self, ca: Option<PathBuf>) -> Self {
        self.ca = ca;
        self
    }

    fn is_encrypted(&self) -> bool {
        let scheme = self.url.split("://").next();
        scheme.is_some_and(|scheme| scheme.eq_ignore_ascii_case("https"))
    }

    /// Connects.
    pub(crate) async fn connect(&self) -> Result<Channel, NodeError> {
        let mut endpoint = Endpoint::try_from(self.url.clone())
            .map_err(|error| self.unreachable(&error))?
            .connect_timeout(PATIENCE);
        if self.is_encrypted() {
            let tls = ClientTlsConfig::new()
                .trust_anchors(self.roots()?.roots)
                .timeout(PATIENCE);
            let encrypted = endpoint.tls_config(tls);
            endpoint = encrypted.map_err(|error| self.unreachable(&error))?;
        } else {
            if let Some(ca) = &self.ca {
                return Err(NodeError::NotEncrypted {
                    url: self.url.clone(),
                    ca: ca.clone(),
                });
            }
            if !is_loopback(endpoint.uri().host().unwrap_or_default()) {
                let url = &self.url;
                tracing::warn!(
                    "nothing that travels between this machine and {url} is encrypted: use https:// if the aggregator has a certificate"
                );
            }
        }
        let connected = endpoint.connect().await;
        connected.map_err(|error| self.unreachable(&error))
    }

    fn roots(&self) -> Result<RootCertStore, NodeError> {
        let mut roots = RootCertStore::empty();
        match &self.ca {
            Some(path) => {
                let certificates = read(path).map_err(|error| NodeError::Ca {
                    path: path.clone(),
                    error,
                })?;
                for certificate in certificates {
                    roots.add(certificate).map_err(|error| NodeError::Ca {
                        path: path.clone(),
                        error: io::Error::other(error),
                    })?;
                }
            }
            None => {
                let system = rustls_native_certs::load_native_certs();
                let (added, _) = roots.add_parsable_certificates(system.certs);
                if added == 0 {
                    return Err(NodeError::NoRoots);
                }
            }
        }
        Ok(roots)
    }

    /// Why the aggregator cannot be reached, from the first cause that says something.
    fn unreachable(&self, error: &(dyn Error + 'static)) -> NodeError {
        let why = match tls_error(error) {
            Some(error) => self.tls_failure(error),
            None => {
                let last = causes(error).last();
                let why = last.map_or_else(|| error.to_string(), |cause| cause.to_string());
                match self.is_encrypted() && why.contains("tls handshake eof") {
                    true => "the server ended the connection during the TLS handshake; perhaps it does not speak TLS".into(),
                    false => why,
                }
            }
        };
        NodeError::Connect {
            url: self.url.clone(),
            why,
        }
    }

    fn tls_failure(&self, error: &rustls::Error) -> String {
        let trusted = match &self.ca {
            Some(path) => format!("a certificate in {}", path.display()),
            None => "an authority that this machine trusts: name the right one with --ca".into(),
        };
        use rustls::Error::{AlertReceived, InvalidCertificate, InvalidMessage};
        match error {
            InvalidCertificate(
                CertificateError::UnknownIssuer | CertificateError::BadSignature,
            ) => {
                format!("its certificate is not signed by {trusted}")
            }
            InvalidCertificate(
                error @ (CertificateError::Expired
                | CertificateError::ExpiredContext { .. }
                | CertificateError::NotValidYet
                | CertificateError::NotValidYetContext { .. }),
            ) => format!(
                "its certificate is not valid now: {error}; or the clock of this machine is wrong"
            ),
            InvalidCertificate(
                error @ (CertificateError::NotValidForName
                | CertificateError::NotValidForNameContext { .. }),
            ) => format!("its certificate is for another name: {error}"),
            InvalidCertificate(error) => format!("its certificate is refused: {error}"),
            InvalidMessage(_) => "it does not speak TLS: use http:// if that is right".into(),
            AlertReceived(AlertDescription::NoApplicationProtocol) => {
                "it speaks TLS, but not HTTP/2: is this the address of the log?".into()
            }
            other => other.to_string(),
        }
    }

    /// What the failure of the first request means: whoever does not speak HTTP/2 shows it only then.
    pub(crate) fn first_failure(&self, status: tonic::Status) -> NodeError {
        // What an aggregator answers has no source. A lost connection has one, and how it was lost depends on who was faster.
        let Some(cause) = status.source().and_then(|cause| causes(cause).last()) else {
            return status.into();
        };
        let why = match self.is_encrypted() {
            true => format!("the connection ended before it answered: {cause}"),
            false => format!(
                "it does not answer in plain HTTP/2 ({cause}): use https:// if it speaks TLS"
            ),
        };
        NodeError::Connect {
            url: self.url.clone(),
            why,
        }
    }
}

fn read(path: &Path) -> io::Result<Vec<CertificateDer<'static>>> {
    let text = bounded_file::read(path, MAX_CA_BYTES)?;
    let certificates: Result<Vec<_>, _> = CertificateDer::pem_slice_iter(&text).collect();
    match certificates {
        Ok(certificates) if !certificates.is_empty() => Ok(certificates),
        _ => Err(io::Error::other("it is not a PEM file with certificates")),
    }
}

fn is_loopback(host: &str) -> bool {
    let address = host.trim_start_matches('[').trim_end_matches(']');
    match address.parse::<IpAddr>() {
        Ok(address) => address.is_loopback(),
        Err(_) => host == "localhost",
    }
}

/// An error and what caused it.
fn causes<'a>(error: &'a (dyn Error + 'static)) -> impl Iterator<Item = &'a (dyn Error + 'static)> {
    std::iter::successors(Some(error), |&error| error.source())
}

fn tls_error<'a>(error: &'a (dyn Error + 'static)) -> Option<&'a rustls::Error> {
    causes(error).find_map(|cause| {
        let inner = cause
            .downcast_ref::<io::Error>()
            .and_then(io::Error::get_ref);
        let inner = inner.and_then(|inner| inner.downcast_ref());
        inner.or_else(|| cause.downcast_ref())
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn loopback_is_told_from_the_network() {
        for host in ["127.0.0.1", "127.8.9.1", "localhost", "[::1]"] {
            assert!(is_loopback(host), "{host}");
        }
        for host in ["192.0.2.1", "localhost.example", "[2001:db8::1]", ""] {
            assert!(!is_loopback(host), "{host}");
        }
    }
}
