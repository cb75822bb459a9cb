//! A recording on the Hub.

/// Which recording: `owner/name`, or `owner/name@revision` for another branch, tag or commit than `main`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct HubRecording {
    /// `owner/name`.
    pub repository: String,
    /// Branch, tag or commit.
    pub revision: String,
}

impl std::fmt::Display for HubRecording {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        write!(f, "{}@{}", self.repository, self.revision)
    }
}
