//! A published log under an address, read over HTTP.

use crate::published::source::{Source, SourceError};
use std::io::{self, Read};
use std::path::Path;
use std::time::Duration;
use ureq::config::ConfigBuilder;
use ureq::tls::{parse_pem, PemItem, RootCerts, TlsConfig};
use ureq::typestate::AgentScope;
use zk0_files::bounded_file;

/// Largest file of certificates that is read.
const MAX_CA_BYTES: u64 = 1 << 20;

/// A log that is served under an address.
pub struct Web {
    agent: ureq::Agent,
    base: String,
}

impl Web {
    /// The log under `url`, such as `https://host/log`. This fetches nothing. With the PEM file `ca`, only the authorities in it count, and
    /// otherwise public authorities do.
    ///
    /// # Errors
    /// This is no such address, it is not encrypted and there is a `ca`, or the file holds no certificate.
    pub fn at(url: &str, ca: Option<&Path>) -> Result<Self, SourceError> {
        let encrypted = url.starts_with("https://");
        if !(encrypted || url.starts_with("http://")) {
            let why = "this is not an address that begins with http:// or https://".into();
            return Err(SourceError::new(url, why));
        }
        let mut config = ureq::Agent::config_builder();
        if let Some(ca) = ca {
            if !encrypted {
                let why = "there is no certificate to check with --ca: use https://".into();
                return Err(SourceError::new(url, why));
            }
            let name = ca.display().to_string();
            let roots = roots(ca).map_err(|error| SourceError::new(&name, error.to_string()))?;
            config = config.tls_config(TlsConfig::builder().root_certs(roots).build());
        }
        Ok(Self {
            agent: patient(config, Duration::from_secs(600)),
            base: url.trim_end_matches('/').into(),
        })
    }
}

impl Source for Web {
    fn open(&self, path: &str) -> Result<Option<Box<dyn Read>>, SourceError> {
        let url = format!("{}/{path}", self.base);
        let failed = |why: String| SourceError::new(&url, why);
        let response = self
            .agent
            .get(&url)
            .call()
            .map_err(|error| failed(error.to_string()))?;
        match response.status().as_u16() {
            200 => Ok(Some(Box::new(response.into_body().into_reader()))),
            404 | 410 => Ok(None),
            status => Err(failed(format!("the server answers with status {status}"))),
        }
    }
}

/// A client that gives up after `timeout`. A response with an error status is a response, and not an error of the client.
pub fn agent(timeout: Duration) -> ureq::Agent {
    patient(ureq::Agent::config_builder(), timeout)
}

fn patient(config: ConfigBuilder<AgentScope>, timeout: Duration) -> ureq::Agent {
    config
        .timeout_global(Some(timeout))
        .timeout_connect(Some(timeout.min(Duration::from_secs(10))))
        .http_status_as_error(false)
        .build()
        .into()
}

/// The authorities in a PEM file.
fn roots(file: &Path) -> io::Result<RootCerts> {
    let pem = bounded_file::read(file, MAX_CA_BYTES)?;
    let mut found = vec![];
    for item in parse_pem(&pem) {
        if let PemItem::Certificate(certificate) = item.map_err(io::Error::other)? {
            found.push(certificate);
        }
    }
    match found.is_empty() {
        true => Err(io::Error::other(
            "the file holds no certificate in PEM form",
        )),
        false => Ok(RootCerts::from(found)),
    }
}
