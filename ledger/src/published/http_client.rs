//! A blocking HTTP client, which explains what is wrong with a server's certificate.

use std::time::Duration;
use ureq::http::Response;
use ureq::tls::{Certificate, RootCerts, TlsConfig};
use ureq::Body;
use zk0_service::tls::authorities::{tls_error, Authorities, AuthoritiesError};

const CONNECTING: Duration = Duration::from_secs(10);

/// Sends requests, over TLS to addresses that begin with `https://`.
#[derive(Clone, Debug)]
pub struct HttpClient {
    agent: ureq::Agent,
    authorities: Authorities,
    /// Why no certificate can be checked.
    no_roots: Option<String>,
}

/// A request failed.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{why}")]
pub struct HttpError {
    why: String,
    may_pass: bool,
}

impl HttpError {
    /// Whether the same request may succeed soon.
    pub fn may_pass(&self) -> bool {
        self.may_pass
    }
}

#[derive(Clone, Copy)]
enum RequestTimeout {
    /// For the whole answer.
    Whole(Duration),
    /// For the answer's start, and then for each part.
    Parts(Duration),
}

impl HttpClient {
    /// A client that trusts these authorities, and gives up a request after `timeout`. If the system has none, only TLS requests fail.
    ///
    /// # Errors
    /// The file of authorities is unusable.
    pub fn new(authorities: Authorities, timeout: Duration) -> Result<Self, AuthoritiesError> {
        Self::checked(authorities, RequestTimeout::Whole(timeout))
    }

    /// [`Self::new`], for files of any size: gives up after `silence` without a byte.
    ///
    /// # Errors
    /// The file of authorities is unusable.
    pub fn for_files(
        authorities: Authorities,
        silence: Duration,
    ) -> Result<Self, AuthoritiesError> {
        Self::checked(authorities, RequestTimeout::Parts(silence))
    }

    /// A client that trusts the system's authorities. `option` names others.
    pub fn of_system(option: &'static str, timeout: Duration) -> Self {
        let authorities = Authorities::of_system(option);
        Self::believing(authorities, RequestTimeout::Whole(timeout))
    }

    fn checked(
        authorities: Authorities,
        waiting: RequestTimeout,
    ) -> Result<Self, AuthoritiesError> {
        if authorities.file().is_some() {
            authorities.certificates()?;
        }
        Ok(Self::believing(authorities, waiting))
    }

    fn believing(authorities: Authorities, waiting: RequestTimeout) -> Self {
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
        let (whole, part) = match waiting {
            RequestTimeout::Whole(whole) => (Some(whole), None),
            RequestTimeout::Parts(part) => (None, Some(part)),
        };
        let connecting = whole.or(part).map(|time| time.min(CONNECTING));
        let agent = ureq::Agent::config_builder()
            .tls_config(tls)
            // A named authority also means encrypted redirects.
            .https_only(authorities.file().is_some())
            .timeout_global(whole)
            .timeout_resolve(part.and(connecting))
            .timeout_connect(connecting)
            .timeout_send_request(part)
            .timeout_recv_response(part)
            .timeout_per_read(part)
            // An error status is an answer, too.
            .http_status_as_error(false)
            .build()
            .into();
        Self {
            agent,
            authorities,
            no_roots,
        }
    }

    /// Requests `url`.
    pub fn get(&self, url: &str) -> Result<Response<Body>, HttpError> {
        self.agent.get(url).call().map_err(|error| self.why(&error))
    }

    /// Requests `url` from byte `begins` on. The server may answer with all of it (status 200).
    pub fn get_from(&self, url: &str, begins: u64) -> Result<Response<Body>, HttpError> {
        // Bytes are counted uncompressed.
        let mut request = self.agent.get(url).header("accept-encoding", "identity");
        if begins > 0 {
            request = request.header("range", format!("bytes={begins}-"));
        }
        request.call().map_err(|error| self.why(&error))
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

    /// Explains a failure, also while an answer is read.
    pub fn why(&self, error: &ureq::Error) -> HttpError {
        let of_tls = match error {
            ureq::Error::Rustls(error) => Some(error),
            ureq::Error::Io(error) => tls_error(error),
            _ => None,
        };
        let broken = matches!(
            error,
            ureq::Error::Io(_)
                | ureq::Error::Timeout(_)
                | ureq::Error::HostNotFound
                | ureq::Error::ConnectionFailed
        );
        HttpError {
            // A bad certificate stays bad.
            may_pass: broken && of_tls.is_none(),
            why: match (of_tls, &self.no_roots) {
                (Some(rustls::Error::InvalidCertificate(_)), Some(why)) => why.clone(),
                (Some(error), _) => self.authorities.meaning(error),
                (None, _) => error.to_string(),
            },
        }
    }
}
