//! A published log under an address, read over HTTP.

use crate::published::source::{Source, SourceError};
use std::io::Read;
use std::time::Duration;

/// A log that is served under an address.
pub struct Web {
    agent: ureq::Agent,
    base: String,
}

impl Web {
    /// The log under `url`, such as `https://host/log`. This fetches nothing.
    pub fn at(url: &str) -> Result<Self, SourceError> {
        if !(url.starts_with("http://") || url.starts_with("https://")) {
            let why = "this is not an address that begins with http:// or https://".into();
            return Err(SourceError::new(url, why));
        }
        Ok(Self {
            agent: agent(Duration::from_secs(600)),
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
    ureq::Agent::config_builder()
        .timeout_global(Some(timeout))
        .timeout_connect(Some(timeout.min(Duration::from_secs(10))))
        .http_status_as_error(false)
        .build()
        .into()
}
