//! Logs and witnesses over HTTP, as a client sees them.

use std::{io::Read, time::Duration};
use zk0_ledger::source::{Source, SourceError};

/// A log that is served under an address.
pub struct Web {
    agent: ureq::Agent,
    base: String,
}

/// What a witness answered.
#[cfg(feature = "service")]
pub(crate) struct Answer {
    /// HTTP status.
    pub status: u16,
    /// Body.
    pub body: Vec<u8>,
}

impl Web {
    /// The log under `url`, such as `https://host/log`. Nothing is fetched yet.
    pub fn at(url: &str) -> Result<Self, SourceError> {
        if !(url.starts_with("http://") || url.starts_with("https://")) {
            let why = "not an address that begins with http:// or https://".into();
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

/// Posts a body and reads an answer of at most `limit` bytes.
#[cfg(feature = "service")]
pub(crate) fn post(
    agent: &ureq::Agent,
    url: &str,
    body: &[u8],
    limit: u64,
) -> Result<Answer, String> {
    let mut response = agent
        .post(url)
        .send(body)
        .map_err(|error| error.to_string())?;
    let status = response.status().as_u16();
    let body = response
        .body_mut()
        .with_config()
        .limit(limit)
        .read_to_vec()
        .map_err(|error| error.to_string())?;
    Ok(Answer { status, body })
}

/// A client that gives up after `timeout`, and takes every status as an answer.
pub(crate) fn agent(timeout: Duration) -> ureq::Agent {
    ureq::Agent::config_builder()
        .timeout_global(Some(timeout))
        .timeout_connect(Some(timeout.min(Duration::from_secs(10))))
        .http_status_as_error(false)
        .build()
        .into()
}
