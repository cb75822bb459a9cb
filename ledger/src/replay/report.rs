//! A replay's report: findings and a verdict.

use super::stopped::Stopped;
use crate::error::LedgerError;
use borsh::{BorshDeserialize, BorshSerialize};
use serde::Serialize;
use zk0_protocol::rules::network_rules::Rules;

/// Something that an auditor should know.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, BorshSerialize, BorshDeserialize)]
pub struct Finding {
    /// Its entry, if it is about one.
    pub index: Option<u64>,
    /// Its severity.
    pub severity: Severity,
    /// The finding in words.
    pub text: String,
}

/// How serious a finding is.
#[derive(
    Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, BorshSerialize, BorshDeserialize,
)]
#[serde(rename_all = "kebab-case")]
pub enum Severity {
    /// Deserves a look. The verdict does not change.
    Note,
    /// Not checked: [`Verdict::Incomplete`] at best.
    NotChecked,
    /// Wrong: [`Verdict::Failed`].
    Fault,
}

/// The verdict on a history.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Verdict {
    /// Everything was checked, and nothing is wrong.
    Verified,
    /// Nothing wrong was found, but something was not checked.
    Incomplete,
    /// Something is wrong.
    Failed,
}

/// The result of a replay.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct ReplayReport {
    /// The verdict.
    pub verdict: Verdict,
    /// The network's name, from the genesis.
    pub name: Option<String>,
    /// The network's id, in hexadecimal.
    pub network: Option<String>,
    /// Verified entries.
    pub entries: u64,
    /// Verified checkpoints.
    pub checkpoints: u64,
    /// Root of the last verified tree, in hexadecimal.
    pub root: Option<String>,
    /// Digest of the state after the last verified entry, in hexadecimal.
    pub state: Option<String>,
    /// The rules in force after the last verified entry.
    pub rules: Option<Rules>,
    /// Why saving failed. The next replay then notices no rollback since the last save.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub unsaved: Option<String>,
    /// Why the replay could not read to the end, such as a failed disk: no verdict about the ledger. Also among the findings.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub unread: Option<Finding>,
    /// The findings: by entry, then what was not checked, then why the replay stopped.
    pub findings: Vec<Finding>,
}

impl Finding {
    /// Makes the verdict [`Verdict::Failed`].
    pub fn fault(index: impl Into<Option<u64>>, text: impl Into<String>) -> Self {
        Self {
            index: index.into(),
            severity: Severity::Fault,
            text: text.into(),
        }
    }

    /// Makes the verdict [`Verdict::Incomplete`] at best.
    pub fn not_checked(index: impl Into<Option<u64>>, text: impl Into<String>) -> Self {
        Self {
            severity: Severity::NotChecked,
            ..Self::fault(index, text)
        }
    }

    /// Does not change the verdict.
    pub fn note(index: impl Into<Option<u64>>, text: impl Into<String>) -> Self {
        Self {
            severity: Severity::Note,
            ..Self::fault(index, text)
        }
    }
}

/// A stop is a fault, unless the ledger is just unreadable.
impl From<Stopped> for Finding {
    fn from(Stopped { index, error }: Stopped) -> Self {
        match error {
            LedgerError::BadEntry { index, why } => Self::fault(index, why),
            error if error.is_of_reading() => Self::not_checked(index, error.to_string()),
            error => Self::fault(index, error.to_string()),
        }
    }
}

impl From<LedgerError> for Finding {
    fn from(error: LedgerError) -> Self {
        Stopped::from(error).into()
    }
}
