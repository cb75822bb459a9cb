//! A repository's name on the Hub.

use std::fmt;
use std::str::FromStr;

/// The Hub's limit.
const MAX_NAME: usize = 96;

/// A model's repository: `owner/name`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Repository {
    /// A user or an organisation.
    pub owner: String,
    /// The model's name.
    pub name: String,
}

/// The text does not name a repository.
#[derive(Debug, thiserror::Error)]
#[error("{0:?} does not name a repository on the Hub; write owner/name")]
pub struct InvalidName(String);

impl FromStr for Repository {
    type Err = InvalidName;

    fn from_str(given: &str) -> Result<Self, InvalidName> {
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
            _ => Err(InvalidName(given.into())),
        }
    }
}

impl fmt::Display for Repository {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        write!(f, "{}/{}", self.owner, self.name)
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
