//! Why a folder is not published, and what to do.

use crate::repository::Repository;
use std::io;
use std::path::PathBuf;

/// Why a folder is not published.
#[derive(Debug, thiserror::Error)]
pub enum PublishError {
    /// Nobody says who writes.
    #[error("there is no token for the Hub: set HF_TOKEN to one that may write to {repository} (https://huggingface.co/settings/tokens)")]
    NoToken {
        /// The repository.
        repository: Repository,
    },
    /// The token is not valid.
    #[error("{endpoint} does not accept the token (HTTP 401: {said}): set HF_TOKEN to a valid token that may write to {repository} (https://huggingface.co/settings/tokens)")]
    Token {
        /// The Hub.
        endpoint: String,
        /// The repository.
        repository: Repository,
        /// What the Hub says.
        said: String,
    },
    /// The token may not write there.
    #[error("the token may not write to {repository} at {endpoint} (HTTP 403: {said}): use a token with the role \"write\" of an account that may write there")]
    Forbidden {
        /// The Hub.
        endpoint: String,
        /// The repository.
        repository: Repository,
        /// What the Hub says.
        said: String,
    },
    /// The Hub, or the way to it, does not work now.
    #[error("{what} failed {tries} times, the last time because {why}: try again later; what has arrived is not uploaded again")]
    Unavailable {
        /// What was asked for.
        what: String,
        /// How often.
        tries: u32,
        /// Why it failed the last time.
        why: String,
    },
    /// The Hub refuses something else.
    #[error("{endpoint} refuses {what} (HTTP {status}: {said})")]
    Refused {
        /// The Hub.
        endpoint: String,
        /// What was asked for.
        what: String,
        /// The status of its answer.
        status: u16,
        /// What it says.
        said: String,
    },
    /// The Hub's answer is not what its API promises.
    #[error("the answer of {endpoint} to {what} cannot be used: {why}; is it a Hugging Face Hub?")]
    Answer {
        /// The Hub.
        endpoint: String,
        /// What was asked for.
        what: String,
        /// What is wrong.
        why: String,
    },
    /// A file cannot be read, or cannot be published.
    #[error("{path}: {why}")]
    File {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        why: String,
    },
}

impl PublishError {
    /// Of a file that cannot be read.
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
    /// It may go better later. Says what was asked for, and why it failed.
    Temporary {
        /// What was asked for.
        what: String,
        /// Why it failed.
        why: String,
    },
    /// It will not go better.
    Final(PublishError),
}

impl From<PublishError> for Failure {
    fn from(error: PublishError) -> Self {
        Self::Final(error)
    }
}
