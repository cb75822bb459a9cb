//! Requests to the Hub, and their answers.

use crate::hub::error::{Failure, PublishError};
use crate::hub::target::PublishTarget;
use serde::de::DeserializeOwned;
use serde_json::Value;
use std::fs::File;
use std::time::Duration;
use ureq::http::{Response, StatusCode};
use ureq::Body;

const CONNECTING: Duration = Duration::from_secs(20);
/// Longest silence.
const SILENCE: Duration = Duration::from_secs(120);
/// Largest answer read.
const MAX_ANSWER: u64 = 4 << 20;
/// Bytes of an error's text shown.
const MAX_SAID: usize = 300;

/// The Hub's client.
pub struct Client<'t> {
    agent: ureq::Agent,
    /// The target.
    pub target: &'t PublishTarget,
}

/// A request.
pub struct Sent<'a> {
    /// Its name in errors.
    pub what: &'a str,
    /// Its address.
    pub url: &'a str,
    /// Its type.
    pub content_type: &'a str,
    /// Its content.
    pub body: &'a [u8],
}

impl<'t> Client<'t> {
    /// A client for this target.
    pub fn new(target: &'t PublishTarget) -> Self {
        let agent = ureq::Agent::config_builder()
            .timeout_connect(Some(CONNECTING))
            .timeout_per_read(Some(SILENCE))
            .timeout_per_write(Some(SILENCE))
            .timeout_recv_response(Some(SILENCE))
            // An error status is an answer, too.
            .http_status_as_error(false)
            .user_agent(concat!("zk0/", env!("CARGO_PKG_VERSION")))
            .build()
            .into();
        Self { agent, target }
    }

    /// An API address about the repository.
    pub fn model(&self, rest: &str) -> String {
        let PublishTarget {
            endpoint,
            repository,
            ..
        } = self.target;
        format!("{endpoint}/api/models/{repository}{rest}")
    }

    /// The status of a GET.
    pub fn status(&self, what: &str, url: &str) -> Result<StatusCode, Failure> {
        let asked = self.agent.get(url).header("authorization", self.bearer());
        let answer = asked.call().map_err(|error| failed(what, &error))?;
        Ok(answer.status())
    }

    /// Posts to the Hub.
    pub fn post(&self, sent: &Sent) -> Result<Response<Body>, Failure> {
        let asked = self
            .agent
            .post(sent.url)
            .header("authorization", self.bearer())
            .header("content-type", sent.content_type);
        // As Git LFS wants it.
        let asked = if sent.content_type.ends_with("lfs+json") {
            asked.header("accept", sent.content_type)
        } else {
            asked
        };
        asked
            .send(sent.body)
            .map_err(|error| failed(sent.what, &error))
    }

    /// Posts JSON to the Hub.
    pub fn post_json(
        &self,
        what: &str,
        url: &str,
        body: &Value,
    ) -> Result<Response<Body>, Failure> {
        self.post(&Sent {
            what,
            url,
            content_type: "application/json",
            body: body.to_string().as_bytes(),
        })
    }

    /// Puts a file into the large files' storage, without the token: the address is signed.
    pub fn put(
        &self,
        what: &str,
        url: &str,
        headers: &[(String, String)],
        file: &File,
    ) -> Result<Response<Body>, Failure> {
        let mut asked = self.agent.put(url);
        for (name, value) in headers {
            asked = asked.header(name, value);
        }
        asked.send(file).map_err(|error| failed(what, &error))
    }

    /// A successful answer.
    pub fn succeeded(&self, what: &str, answer: Response<Body>) -> Result<Response<Body>, Failure> {
        if answer.status().is_success() {
            Ok(answer)
        } else {
            Err(self.refused(what, answer))
        }
    }

    /// Its content.
    pub fn json<T: DeserializeOwned>(
        &self,
        what: &str,
        answer: Response<Body>,
    ) -> Result<T, Failure> {
        let bytes = read(self.succeeded(what, answer)?).map_err(|error| failed(what, &error))?;
        serde_json::from_slice(&bytes).map_err(|error| self.unusable(what, error.to_string()))
    }

    /// The failure for an answer outside the API.
    pub fn unusable(&self, what: &str, why: String) -> Failure {
        Failure::Final(PublishError::Answer {
            endpoint: self.target.endpoint.clone(),
            what: what.into(),
            why,
        })
    }

    /// The failure for an error status.
    pub fn refused(&self, what: &str, answer: Response<Body>) -> Failure {
        let status = answer.status();
        let reported = reported(answer);
        let (endpoint, repository) = (self.target.endpoint.clone(), self.target.repository.clone());
        Failure::Final(match status.as_u16() {
            401 => PublishError::Token {
                endpoint,
                repository,
                reported,
            },
            403 => PublishError::Forbidden {
                endpoint,
                repository,
                reported,
            },
            // Too slow, too many requests, a fault, or a changed state (412).
            408 | 412 | 429 | 500..=599 => {
                return Failure::Temporary {
                    what: what.into(),
                    why: format!("{endpoint} answered with HTTP {status} ({reported})"),
                }
            }
            status => PublishError::Refused {
                endpoint,
                what: what.into(),
                status,
                reported,
            },
        })
    }

    fn bearer(&self) -> String {
        format!("Bearer {}", self.target.token)
    }
}

fn failed(what: &str, error: &ureq::Error) -> Failure {
    Failure::Temporary {
        what: what.into(),
        why: error.to_string(),
    }
}

fn read(answer: Response<Body>) -> Result<Vec<u8>, ureq::Error> {
    let body = answer.into_body();
    body.into_with_config().limit(MAX_ANSWER).read_to_vec()
}

fn reported(answer: Response<Body>) -> String {
    let reason = answer.status().canonical_reason().unwrap_or("no reason");
    let bytes = read(answer).unwrap_or_default();
    let text = match serde_json::from_slice::<Value>(&bytes) {
        Ok(value) => value["error"].as_str().unwrap_or_default().to_owned(),
        Err(_) => String::new(),
    };
    let text: String = text
        .chars()
        .filter(|one| !one.is_control())
        .take(MAX_SAID)
        .collect();
    if text.is_empty() {
        reason.into()
    } else {
        text
    }
}
