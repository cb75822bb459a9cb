//! Reads a file of a served log to its end. After a broken connection or a passing failure, it asks for the rest. The caller verifies the
//! bytes.

use crate::published::http_client::{HttpClient, HttpError};
use crate::published::patience::{FailedRequest, RetryBudget, LEAST_BYTES, WITHIN};
use std::io::{self, Read};
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::sleep;
use std::time::{Duration, Instant};
use ureq::http::Response;
use ureq::Body;
use zk0_protocol::quote::short;

/// How much is read of a refusal's text.
const MAX_REASON_BYTES: u64 = 1 << 10;

pub(super) struct WebFile {
    client: HttpClient,
    url: String,
    body: Box<dyn Read>,
    /// How many of its first bytes are here, because the server cannot send a rest.
    skip: u64,
    at: u64,
    /// The file's length, once the server has named it.
    length: Option<u64>,
    patience: RetryBudget,
}

#[derive(Debug, thiserror::Error)]
pub(super) enum WebError {
    #[error(transparent)]
    Http(#[from] HttpError),
    #[error("the server answers with status {status}{reported}")]
    Status {
        status: u16,
        reported: String,
        again: Option<Duration>,
    },
    #[error("the answer ends after {0} bytes, before the end of the file")]
    Early(u64),
    #[error("the server was asked for the bytes from {at} on, and answers with others: {answer}")]
    OtherBytes { at: u64, answer: String },
    #[error("the file had {before} bytes, and now the server states {now}")]
    OtherLength { before: u64, now: u64 },
    #[error("the server has this file no more")]
    Gone,
    #[error(
        "the server sent less than {} MiB in {} minutes",
        LEAST_BYTES >> 20,
        WITHIN.as_secs() / 60
    )]
    Slow,
}

impl WebError {
    fn failed(&self) -> FailedRequest {
        match self {
            Self::Http(error) if error.may_pass() => FailedRequest::Passing { again: None },
            Self::Early(_) => FailedRequest::Passing { again: None },
            Self::Status {
                status: 503,
                again: None,
                ..
            } => FailedRequest::Unavailable,
            Self::Status {
                status: 408 | 429 | 502 | 503 | 504,
                again,
                ..
            } => FailedRequest::Passing { again: *again },
            _ => FailedRequest::ForGood,
        }
    }
}

impl WebFile {
    /// Asks for the file at `url`; `None` if the server has none. `answered` records whether the server has ever answered. Until then, the
    /// address may be wrong, so it is not asked again.
    pub fn open(
        client: HttpClient,
        url: String,
        answered: &AtomicBool,
    ) -> Result<Option<Self>, WebError> {
        let mut file = Self {
            client,
            url,
            body: Box::new(io::empty()),
            skip: 0,
            at: 0,
            length: None,
            patience: RetryBudget::default(),
        };
        loop {
            let begun = Instant::now();
            match file.ask() {
                Ok(found) => {
                    answered.store(true, Ordering::Relaxed);
                    return Ok(found.then_some(file));
                }
                Err(error @ WebError::Http(_)) if !answered.load(Ordering::Relaxed) => {
                    return Err(error);
                }
                Err(error) => {
                    answered.store(true, Ordering::Relaxed);
                    file.wait(error, begun)?;
                }
            }
        }
    }

    /// Asks for the rest. Returns whether the server has the file.
    fn ask(&mut self) -> Result<bool, WebError> {
        let response = self.client.get_from(&self.url, self.at)?;
        let sent = header(&response, "content-length").and_then(|length| length.parse().ok());
        let (skip, length) = match response.status().as_u16() {
            200 => (self.at, sent),
            206 if self.at > 0 => {
                let range = header(&response, "content-range").unwrap_or_default();
                let length = length_of(range, self.at, sent);
                let length = length.ok_or_else(|| WebError::OtherBytes {
                    at: self.at,
                    answer: short(range),
                })?;
                (0, Some(length))
            }
            404 | 410 => return Ok(false),
            status => return Err(refusal(status, response)),
        };
        if let (Some(before), Some(now)) = (self.length, length) {
            if before != now {
                return Err(WebError::OtherLength { before, now });
            }
        }
        self.length = self.length.or(length);
        self.skip = skip;
        self.body = Box::new(response.into_body().into_reader());
        Ok(true)
    }

    /// Waits for the next try after `error`, from a try that began at `begun`, or fails with it.
    fn wait(&mut self, error: WebError, begun: Instant) -> Result<(), WebError> {
        let Some(wait) = self.patience.next_wait(error.failed()) else {
            return Err(error);
        };
        if !self.patience.keeps_pace(0, begun.elapsed() + wait) {
            return Err(error);
        }
        let (url, at) = (&self.url, self.at);
        tracing::debug!("{url}: {error}; asking again from byte {at} on in {wait:?}");
        sleep(wait);
        Ok(())
    }

    /// Asks again until the missing bytes come, or no try is left.
    fn go_on(&mut self, mut error: WebError, mut begun: Instant) -> Result<(), WebError> {
        loop {
            self.wait(error, begun)?;
            begun = Instant::now();
            error = match self.ask() {
                Ok(true) if self.patience.keeps_pace(0, begun.elapsed()) => return Ok(()),
                Ok(true) => return Err(WebError::Slow),
                Ok(false) => return Err(WebError::Gone),
                Err(error) => error,
            };
        }
    }

    /// Reads the answer's next bytes, to skip or new; none at the file's end.
    fn part(&mut self, buffer: &mut [u8]) -> Result<usize, WebError> {
        let most = match self.skip {
            0 => buffer.len(),
            skip => buffer
                .len()
                .min(usize::try_from(skip).unwrap_or(usize::MAX)),
        };
        let read = self.body.read(&mut buffer[..most]);
        let read = read.map_err(|error| self.client.why(&ureq::Error::from(error)))?;
        let missing = self.skip > 0 || self.length.is_some_and(|length| self.at < length);
        if read == 0 && missing {
            return Err(WebError::Early(self.at));
        }
        Ok(read)
    }
}

impl Read for WebFile {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        if buffer.is_empty() {
            return Ok(0);
        }
        loop {
            let begun = Instant::now();
            match self.part(buffer) {
                Ok(read) => {
                    if !self.patience.keeps_pace(read as u64, begun.elapsed()) {
                        return Err(io::Error::other(WebError::Slow));
                    }
                    if self.skip > 0 {
                        self.skip -= read as u64;
                        continue;
                    }
                    if read > 0 {
                        self.at += read as u64;
                        self.patience.progress();
                    }
                    return Ok(read);
                }
                Err(error) => self.go_on(error, begun).map_err(io::Error::other)?,
            }
        }
    }
}

fn header<'a>(response: &'a Response<Body>, name: &str) -> Option<&'a str> {
    response.headers().get(name)?.to_str().ok()
}

/// The file's length in a `range` that begins with byte `at` and has `sent` bytes.
fn length_of(range: &str, at: u64, sent: Option<u64>) -> Option<u64> {
    let (part, length) = range.trim().strip_prefix("bytes ")?.split_once('/')?;
    let (first, last) = part.split_once('-')?;
    let first: u64 = first.parse().ok()?;
    let last: u64 = last.parse().ok()?;
    let length: u64 = length.parse().ok()?;
    let fits = first == at
        && (first..length).contains(&last)
        && sent.is_none_or(|sent| sent == last - first + 1);
    fits.then_some(length)
}

/// A server's text instead of a file. It helps if the port speaks TLS.
fn refusal(status: u16, mut response: Response<Body>) -> WebError {
    let again = header(&response, "retry-after").and_then(|seconds| seconds.parse().ok());
    let reported = response.body_mut().with_config().limit(MAX_REASON_BYTES);
    let reported = reported.read_to_string().unwrap_or_default();
    WebError::Status {
        status,
        reported: match reported.trim() {
            "" => String::new(),
            reported => format!(": {}", short(reported)),
        },
        again: again.map(Duration::from_secs),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_range_that_was_not_asked_for_does_not_fit() {
        let fits = |range| length_of(range, 100, Some(200));
        assert_eq!(fits("bytes 100-299/300"), Some(300));
        // A server may send less. The reader then asks again.
        assert_eq!(fits("bytes 100-299/500"), Some(500));
        for other in [
            "bytes 99-298/300",
            "bytes 101-300/301",
            "bytes 100-298/300",
            "bytes 100-299/299",
            "bytes 100-99/300",
            "bytes 100-299/*",
            "bytes */300",
            "lines 100-299/300",
            "",
        ] {
            assert_eq!(fits(other), None, "{other}");
        }
        assert_eq!(length_of("bytes 100-99/300", 100, None), None);
        assert_eq!(length_of("bytes 100-299/300", 100, None), Some(300));
    }
}
