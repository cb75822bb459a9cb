//! A blocking HTTP client. It says what is wrong with a server's certificate in words that help.

use std::time::Duration;
use ureq::http::Response;
use ureq::tls::{Certificate, RootCerts, TlsConfig};
use ureq::Body;
use zk0_tls::authorities::{tls_error, Authorities, AuthoritiesError};

/// How long a connection may take.
const CONNECTING: Duration = Duration::from_secs(10);

/// Asks servers, with TLS where an address begins with `https://`.
#[derive(Clone, Debug)]
pub struct HttpClient {
    agent: ureq::Agent,
    authorities: Authorities,
    /// Why no certificate can be checked.
    no_roots: Option<String>,
}

/// A server cannot be asked.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct HttpError(String);

impl HttpClient {
    /// A client that believes these authorities, and gives up a request after `timeout`. If the system has no authorities, requests over TLS
    /// fail, and no others.
    ///
    /// # Errors
    /// The file of authorities cannot be used.
    pub fn new(authorities: Authorities, timeout: Duration) -> Result<Self, AuthoritiesError> {
        if authorities.file().is_some() {
            authorities.certificates()?;
        }
        Ok(Self::believing(authorities, timeout))
    }

    /// A client that believes the authorities of the system. `option` names others.
    pub fn of_system(option: &'static str, timeout: Duration) -> Self {
        Self::believing(Authorities::of_system(option), timeout)
    }

    fn believing(authorities: Authorities, timeout: Duration) -> Self {
        let (roots, no_roots) = match authorities.certificates() {
            Ok(found) => (found, None),
            Err(error) => (Vec::new(), Some(error.to_string())),
        };
        let roots: Vec<_> = roots
            .iter()
            .map(|der| Certificate::from_der(der).to_owned())
            .collect();
        let tls = TlsConfig::builder()
            .root_certs(RootCerts::from(roots))
            .build();
        let agent = ureq::Agent::config_builder()
            .tls_config(tls)
            // Nobody may lead a reader who named an authority away from encryption.
            .https_only(authorities.file().is_some())
            .timeout_global(Some(timeout))
            .timeout_connect(Some(timeout.min(CONNECTING)))
            // An answer with an error status is an answer, and not an error of the client.
            .http_status_as_error(false)
            .build()
            .into();
        Self {
            agent,
            authorities,
            no_roots,
        }
    }

    /// Asks for what is at `url`.
    pub fn get(&self, url: &str) -> Result<Response<Body>, HttpError> {
        self.agent.get(url).call().map_err(|error| self.why(&error))
    }

    /// Sends `body` to `url`, with these headers.
    pub fn post(
        &self,
        url: &str,
        headers: &[(&str, &str)],
        body: &[u8],
    ) -> Result<Response<Body>, HttpError> {
        let request = self.agent.post(url);
        let request = headers.iter().fold(request, |request, (name, value)| {
            request.header(*name, *value)
        });
        let sent = request.send(body);
        sent.map_err(|error| self.why(&error))
    }

    /// What goes wrong while an answer is read.
    pub fn why(&self, error: &ureq::Error) -> HttpError {
        let of_tls = match error {
            ureq::Error::Rustls(error) => Some(error),
            ureq::Error::Io(error) => tls_error(error),
            _ => None,
        };
        HttpError(match (of_tls, &self.no_roots) {
            (Some(rustls::Error::InvalidCertificate(_)), Some(why)) => why.clone(),
            (Some(error), _) => self.authorities.meaning(error),
            (None, _) => error.to_string(),
        })
    }
}
