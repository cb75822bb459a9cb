//! Where to publish, who writes, how many tries.

use crate::hub::error::PublishError;
use crate::hub::repository::Repository;
use std::time::Duration;

/// Where to publish.
#[derive(Clone)]
pub struct PublishTarget {
    /// The Hub's address, such as `https://huggingface.co`.
    pub endpoint: String,
    /// A token with write access.
    pub token: String,
    /// The repository.
    pub repository: Repository,
    /// Whether a new repository is private.
    pub private: bool,
    /// Retries.
    pub patience: RetryPolicy,
}

/// How often temporary failures are retried.
#[derive(Clone, Copy, Debug)]
pub struct RetryPolicy {
    /// Tries in all.
    pub tries: u32,
    /// The wait before the second try; it doubles each time.
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
    /// The repository at `endpoint`, by default Hugging Face.
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
