//! Which repository on which Hub, who writes, and how patiently.

use crate::error::PublishError;
use crate::repository::Repository;
use std::time::Duration;

/// Where to publish.
#[derive(Clone)]
pub struct PublishTarget {
    /// The Hub's address, such as `https://huggingface.co`.
    pub endpoint: String,
    /// A token that may write to the repository.
    pub token: String,
    /// The repository.
    pub repository: Repository,
    /// Whether a repository that is made is private.
    pub private: bool,
    /// How patient to be.
    pub patience: RetryPolicy,
}

/// How often everything is tried that may go better later.
#[derive(Clone, Copy, Debug)]
pub struct RetryPolicy {
    /// Tries in all.
    pub tries: u32,
    /// How long to wait before the second one. Each further wait is twice as long.
    pub first_wait: Duration,
}

impl Default for RetryPolicy {
    /// Half a minute in all.
    fn default() -> Self {
        Self {
            tries: 5,
            first_wait: Duration::from_secs(2),
        }
    }
}

impl PublishTarget {
    /// The repository at `endpoint`, by default that of Hugging Face.
    ///
    /// # Errors
    /// There is no token.
    pub fn new(
        repository: Repository,
        endpoint: Option<String>,
        token: Option<String>,
    ) -> Result<Self, PublishError> {
        let Some(token) = token else {
            return Err(PublishError::NoToken { repository });
        };
        let endpoint = endpoint.unwrap_or_else(|| "https://huggingface.co".into());
        Ok(Self {
            endpoint: endpoint.trim_end_matches('/').into(),
            token,
            repository,
            private: false,
            patience: RetryPolicy::default(),
        })
    }
}
