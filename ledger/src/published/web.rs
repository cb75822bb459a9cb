//! A published log under an address, read over HTTP.

use crate::published::http_client::HttpClient;
use crate::published::source::{Source, SourceError};
use std::io::Read;
use std::path::Path;
use std::time::Duration;
use zk0_protocol::quote::short;
use zk0_tls::authorities::Authorities;

/// How long it may take to read a file.
const PATIENCE: Duration = Duration::from_secs(600);

/// As much is read of what a server says instead of a file.
const MAX_REASON_BYTES: u64 = 1 << 10;

/// A log that is served under an address.
pub struct Web {
    client: HttpClient,
    base: String,
}

impl Web {
    /// The log under `url`, such as `https://host/log`. This fetches nothing. With the PEM file `ca`, only the authorities in it count, and
    /// otherwise those that the system trusts do.
    ///
    /// # Errors
    /// This is no such address, it is not encrypted and there is a `ca`, or the file holds no certificate.
    pub fn at(url: &str, ca: Option<&Path>) -> Result<Self, SourceError> {
        let encrypted = url.starts_with("https://");
        if !(encrypted || url.starts_with("http://")) {
            let why = "this is not an address that begins with http:// or https://".into();
            return Err(SourceError::new(url, why));
        }
        if ca.is_some() && !encrypted {
            let why = "there is no certificate to check with --ca: use https://".into();
            return Err(SourceError::new(url, why));
        }
        let authorities = Authorities::of_system("--ca").in_file(ca.map(Into::into));
        let client = HttpClient::new(authorities, PATIENCE);
        Ok(Self {
            client: client.map_err(|error| SourceError::new(url, error.to_string()))?,
            base: url.trim_end_matches('/').into(),
        })
    }
}

impl Source for Web {
    fn open(&self, path: &str) -> Result<Option<Box<dyn Read>>, SourceError> {
        let url = format!("{}/{path}", self.base);
        let failed = |why: String| SourceError::new(&url, why);
        let mut response = self
            .client
            .get(&url)
            .map_err(|error| failed(error.to_string()))?;
        match response.status().as_u16() {
            200 => Ok(Some(Box::new(response.into_body().into_reader()))),
            404 | 410 => Ok(None),
            status => {
                // What a server says of a bad request helps: the port may speak TLS.
                let said = response.body_mut().with_config().limit(MAX_REASON_BYTES);
                let said = said.read_to_string().unwrap_or_default();
                let said = match said.trim() {
                    "" => String::new(),
                    said => format!(": {}", short(said)),
                };
                Err(failed(format!(
                    "the server answers with status {status}{said}"
                )))
            }
        }
    }
}
