//! Connects a gRPC client to a service by its address, with TLS for `https://`.

use crate::tls::authorities::{causes, tls_error, Authorities, AuthoritiesError};
use futures_core::future::BoxFuture;
use rustls::RootCertStore;
use std::error::Error;
use std::net::IpAddr;
use std::path::PathBuf;
use std::time::Duration;
use tonic::transport::{Channel, ClientTlsConfig, Endpoint, Uri};
use tonic::Status;

/// Time limit for connecting, with the TLS handshake.
const PATIENCE: Duration = Duration::from_secs(10);

/// A service's address, `https://…` or `http://…`, and whose certificates count there.
#[derive(Clone, Debug)]
pub struct ServiceAddress {
    service: &'static str,
    url: String,
    authorities: Authorities,
    silence: Silence,
}

/// How a client notices a cut network: it looks like silence.
#[derive(Clone, Copy, Debug)]
pub struct Silence {
    /// Silence after which the client sends an HTTP/2 ping.
    pub asks_after: Duration,
    /// Wait for its answer before the connection is lost.
    pub lost_after: Duration,
}

/// Why there is no connection.
#[derive(Debug, thiserror::Error)]
pub enum ConnectError {
    /// The text is not an address, nothing answers there, or its certificate is wrong.
    #[error("the {service} at {url} cannot be reached: {why}")]
    Unreachable {
        /// What the service is.
        service: &'static str,
        /// Its address.
        url: String,
        /// The fault.
        why: String,
    },
    /// There are certificates to check, but no encryption.
    #[error("{} states whose certificates count, but the {service} at {url} has none: use https://", .file.display())]
    NotEncrypted {
        /// What the service is.
        service: &'static str,
        /// The address.
        url: String,
        /// The file with the certificates.
        file: PathBuf,
    },
    /// There are no certificates to check with.
    #[error(transparent)]
    Authorities(#[from] AuthoritiesError),
}

/// An aggregator's address, the most common.
impl From<String> for ServiceAddress {
    fn from(url: String) -> Self {
        Self::new("aggregator", url, "--ca")
    }
}

impl ServiceAddress {
    /// The address of a service, such as an "aggregator", where the system's authorities count. The option `option` names others.
    pub fn new(service: &'static str, url: String, option: &'static str) -> Self {
        Self {
            service,
            url,
            authorities: Authorities::of_system(option),
            silence: Silence {
                asks_after: Duration::from_secs(30),
                lost_after: Duration::from_secs(30),
            },
        }
    }

    /// Gives up silent connections after these times.
    pub fn with_silence(mut self, silence: Silence) -> Self {
        self.silence = silence;
        self
    }

    /// Believes only the certificates in this PEM file.
    pub fn with_ca(mut self, file: Option<PathBuf>) -> Self {
        self.authorities = self.authorities.in_file(file);
        self
    }

    /// Whose certificates count there.
    pub fn authorities(&self) -> &Authorities {
        &self.authorities
    }

    /// Whether the connection is encrypted.
    pub fn is_encrypted(&self) -> bool {
        let scheme = self.url.split("://").next();
        scheme.is_some_and(|scheme| scheme.eq_ignore_ascii_case("https"))
    }

    /// The address as given.
    pub fn url(&self) -> &str {
        &self.url
    }

    /// Connects. The future is boxed, so that crates that await it need not compile the client.
    pub fn connect(&self) -> BoxFuture<'_, Result<Channel, ConnectError>> {
        Box::pin(async {
            let endpoint = self.endpoint()?;
            self.warn_if_plain();
            let connected = endpoint.connect().await;
            connected.map_err(|error| self.unreachable(&error))
        })
    }

    /// A channel that connects at its first use, and again after a lost connection. It belongs to the runtime of this call.
    pub fn connect_lazily(&self) -> Result<Channel, ConnectError> {
        let endpoint = self.endpoint()?;
        // An immediate connection would report this fault; here nothing else does.
        match endpoint.uri().scheme_str() {
            Some("http" | "https") => Ok(endpoint.connect_lazy()),
            _ => Err(self.because("an address begins with http:// or https://".into())),
        }
    }

    fn endpoint(&self) -> Result<Endpoint, ConnectError> {
        let endpoint = Endpoint::try_from(self.url.clone())
            .map_err(|error| self.unreachable(&error))?
            .connect_timeout(PATIENCE)
            .http2_keep_alive_interval(self.silence.asks_after)
            .keep_alive_timeout(self.silence.lost_after)
            .keep_alive_while_idle(true);
        if self.is_encrypted() {
            let tls = ClientTlsConfig::new()
                .trust_anchors(self.roots()?.roots)
                .timeout(PATIENCE);
            let encrypted = endpoint.tls_config(tls);
            return encrypted.map_err(|error| self.unreachable(&error));
        }
        match self.authorities.file() {
            None => Ok(endpoint),
            Some(file) => Err(ConnectError::NotEncrypted {
                service: self.service,
                url: self.url.clone(),
                file: file.into(),
            }),
        }
    }

    /// Warns if the connection to another machine is not encrypted.
    pub fn warn_if_plain(&self) {
        let Self { service, url, .. } = self;
        let uri = url.parse::<Uri>().unwrap_or_default();
        if !self.is_encrypted() && !is_loopback(uri.host().unwrap_or_default()) {
            tracing::warn!(
                "nothing that travels between this machine and {url} is encrypted: use https:// if the {service} has a certificate"
            );
        }
    }

    fn roots(&self) -> Result<RootCertStore, AuthoritiesError> {
        let mut roots = RootCertStore::empty();
        let found = self.authorities.certificates()?;
        let (added, _) = roots.add_parsable_certificates(found);
        match added {
            0 => Err(self.authorities.unusable()),
            _ => Ok(roots),
        }
    }

    /// Why the service is unreachable: the first cause with a text.
    fn unreachable(&self, error: &(dyn Error + 'static)) -> ConnectError {
        let why = match tls_error(error) {
            Some(error) => self.authorities.meaning(error),
            None => {
                let last = causes(error).last();
                let why = last.map_or_else(|| error.to_string(), |cause| cause.to_string());
                if self.is_encrypted() && why.contains("tls handshake eof") {
                    "the server ended the connection during the TLS handshake; perhaps it does not speak TLS".into()
                } else {
                    why
                }
            }
        };
        self.because(why)
    }

    /// What the first request's failure means: a side that does not speak HTTP/2 shows it only then. `None` if the service refused.
    pub fn first_failure(&self, status: &Status) -> Option<ConnectError> {
        // A service's answer has no source. A lost connection has one, and how it was lost depends on timing.
        let cause = status.source().and_then(|cause| causes(cause).last())?;
        Some(self.because(if self.is_encrypted() {
            format!("the connection ended before it answered: {cause}")
        } else {
            format!("it does not answer in plain HTTP/2 ({cause}): use https:// if it speaks TLS")
        }))
    }

    /// What a later request's failure means: the connection was lost, or could not be made again. `None` if the service refused.
    pub fn lost(&self, status: &Status) -> Option<ConnectError> {
        // A service's answer has no source.
        Some(self.unreachable(status.source()?))
    }

    /// The service is unreachable, because of `why`.
    pub fn because(&self, why: String) -> ConnectError {
        ConnectError::Unreachable {
            service: self.service,
            url: self.url.clone(),
            why,
        }
    }
}

fn is_loopback(host: &str) -> bool {
    let address = host.trim_start_matches('[').trim_end_matches(']');
    match address.parse::<IpAddr>() {
        Ok(address) => address.is_loopback(),
        Err(_) => host == "localhost",
    }
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
