//! Which repository on which Hub, who writes, and how patiently.

use crate::error::PublishError;
use std::fmt;
use std::str::FromStr;
use std::time::Duration;

/// Longest name of an owner or of a model. The Hub allows 96 characters.
const MAX_NAME: usize = 96;

/// A model's repository: `owner/name`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Repository {
    /// A user or an organisation.
    pub owner: String,
    /// The model's name.
    pub name: String,
}

impl FromStr for Repository {
    type Err = PublishError;

    fn from_str(given: &str) -> Result<Self, PublishError> {
        let plain = |part: &str| {
            let is_plain = |byte: u8| byte.is_ascii_alphanumeric() || b"._-".contains(&byte);
            (1..=MAX_NAME).contains(&part.len())
                && !part.contains("..")
                && !part.starts_with(['.', '-'])
                && part.bytes().all(is_plain)
        };
        match given.split_once('/') {
            Some((owner, name)) if plain(owner) && plain(name) => Ok(Self {
                owner: owner.into(),
                name: name.into(),
            }),
            _ => Err(PublishError::Name {
                given: given.into(),
            }),
        }
    }
}

impl fmt::Display for Repository {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        write!(f, "{}/{}", self.owner, self.name)
    }
}

/// Where to publish.
#[derive(Clone)]
pub struct Target {
    /// The Hub's address, such as `https://huggingface.co`.
    pub endpoint: String,
    /// A token that may write to the repository.
    pub token: String,
    /// The repository.
    pub repository: Repository,
    /// Whether a repository that is made is private.
    pub private: bool,
    /// How patient to be.
    pub patience: Patience,
}

/// How often everything is tried that may go better later.
#[derive(Clone, Copy, Debug)]
pub struct Patience {
    /// Tries in all.
    pub tries: u32,
    /// How long to wait before the second one. Each further wait is twice as long.
    pub first_wait: Duration,
}

impl Default for Patience {
    /// Half a minute in all.
    fn default() -> Self {
        Self {
            tries: 5,
            first_wait: Duration::from_secs(2),
        }
    }
}

impl Target {
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
            patience: Patience::default(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_repositories_are_checked() {
        let right: Repository = "robots/zk0_arm-1.2".parse().unwrap();
        assert_eq!(right.to_string(), "robots/zk0_arm-1.2");
        let long = format!("robots/{}", "a".repeat(97));
        for wrong in [
            "", "robots", "robots/", "/arm", "a/b/c", "a/..", "../a", "a/b c", "a/b?", "a/.b",
            &long,
        ] {
            let error = wrong.parse::<Repository>().unwrap_err().to_string();
            assert!(error.contains("owner/name"), "{wrong}: {error}");
        }
    }
}
