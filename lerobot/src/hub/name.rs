//! Names of recordings on the Hub.

use std::str::FromStr;

use crate::hub::error::HubError;
use crate::hub::recording::HubRecording;

/// The branch without a revision.
pub(super) const DEFAULT_REVISION: &str = "main";

impl FromStr for HubRecording {
    type Err = HubError;

    fn from_str(given: &str) -> Result<Self, HubError> {
        let (repository, revision) = given.split_once('@').unwrap_or((given, DEFAULT_REVISION));
        let plain = |part: &str| {
            !part.is_empty()
                && !part.contains("..")
                && part
                    .bytes()
                    .all(|b| b.is_ascii_alphanumeric() || b"._-".contains(&b))
        };
        let is_repository = repository
            .split_once('/')
            .is_some_and(|(owner, name)| plain(owner) && plain(name));
        if !is_repository || !revision.split('/').all(plain) {
            return Err(HubError::Name {
                given: given.into(),
            });
        }
        Ok(Self {
            repository: repository.into(),
            revision: revision.into(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_recordings() {
        let parse = |given: &str| {
            given
                .parse::<HubRecording>()
                .map(|r| (r.repository, r.revision))
        };
        let pair = |a: &str, b: &str| Some((a.to_owned(), b.to_owned()));
        assert_eq!(
            parse("lerobot/svla_so100").ok(),
            pair("lerobot/svla_so100", "main")
        );
        assert_eq!(parse("a/b@v2.1").ok(), pair("a/b", "v2.1"));
        assert_eq!(parse("a/b@refs/convert").ok(), pair("a/b", "refs/convert"));
        for wrong in [
            "", "a", "a/", "/b", "a/b/c", "../b", "a/..", "a/b@", "a/b@../x", "a b/c", "a/b?x",
        ] {
            assert!(parse(wrong).is_err(), "{wrong}");
        }
    }
}
