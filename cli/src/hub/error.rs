//! Why a folder is not published.

use crate::hub::repository::Repository;
use std::io;
use std::path::PathBuf;

/// Why a folder is not published.
#[derive(Debug, thiserror::Error)]
pub enum PublishError {
    /// There is no token.
    #[error("there is no token for the Hub: set HF_TOKEN to one that may write to {repository} (https://huggingface.co/settings/tokens)")]
    NoToken {
        /// The repository.
        repository: Repository,
    },
    /// The token is invalid.
    #[error("{endpoint} does not accept the token (HTTP 401: {reported}): set HF_TOKEN to a valid token that may write to {repository} (https://huggingface.co/settings/tokens)")]
    Token {
        /// The Hub.
        endpoint: String,
        /// The repository.
        repository: Repository,
        /// The Hub's text.
        reported: String,
    },
    /// The token may not write there.
    #[error("the token may not write to {repository} at {endpoint} (HTTP 403: {reported}): use a token with the role \"write\" of an account that may write there")]
    Forbidden {
        /// The Hub.
        endpoint: String,
        /// The repository.
        repository: Repository,
        /// The Hub's text.
        reported: String,
    },
    /// The Hub or the network fails now.
    #[error("{what} failed {tries} times, the last time because {why}: try again later; what has arrived is not uploaded again")]
    Unavailable {
        /// The request.
        what: String,
        /// How often.
        tries: u32,
        /// The last failure.
        why: String,
    },
    /// The Hub refuses something else.
    #[error("{endpoint} refuses {what} (HTTP {status}: {reported})")]
    Refused {
        /// The Hub.
        endpoint: String,
        /// The request.
        what: String,
        /// The answer's status.
        status: u16,
        /// The Hub's text.
        reported: String,
    },
    /// The answer does not follow the Hub's API.
    #[error("the answer of {endpoint} to {what} cannot be used: {why}; is it a Hugging Face Hub?")]
    Answer {
        /// The Hub.
        endpoint: String,
        /// The request.
        what: String,
        /// The fault.
        why: String,
    },
    /// A file cannot be read or published.
    #[error("{path}: {why}")]
    File {
        /// The file.
        path: PathBuf,
        /// The fault.
        why: String,
    },
}

impl PublishError {
    pub(crate) fn at(path: &std::path::Path) -> impl Fn(io::Error) -> Self + '_ {
        |error| Self::File {
            path: path.into(),
            why: error.to_string(),
        }
    }
}

/// Why a request failed.
#[derive(Debug)]
pub enum Failure {
    /// A retry may help.
    Temporary {
        /// The request.
        what: String,
        /// The reason.
        why: String,
    },
    /// A retry does not help.
    Final(PublishError),
}

impl From<PublishError> for Failure {
    fn from(error: PublishError) -> Self {
        Self::Final(error)
    }
}
