//! The report of a replay: findings, and a verdict on the history.

use super::stopped::Stopped;
use crate::error::LedgerError;
use borsh::{BorshDeserialize, BorshSerialize};
use serde::Serialize;
use zk0_protocol::rules::network_rules::Rules;

/// Something that an auditor should know.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, BorshSerialize, BorshDeserialize)]
pub struct Finding {
    /// The entry it is about.
    pub index: Option<u64>,
    /// How serious it is.
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
    /// Something deserves a look. The verdict does not change.
    Note,
    /// Something was not checked: the verdict is [`Verdict::Incomplete`] at best.
    NotChecked,
    /// Something is wrong: the verdict is [`Verdict::Failed`].
    Fault,
}

/// The verdict on the history.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Verdict {
    /// Everything was checked, and nothing is wrong.
    Verified,
    /// Nothing was found to be wrong, but something was not checked: see the findings.
    Incomplete,
    /// Something is wrong: see the findings.
    Failed,
}

/// The result of a replay.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct ReplayReport {
    /// The verdict.
    pub verdict: Verdict,
    /// The network's name, once the genesis was read.
    pub name: Option<String>,
    /// The network's id, in hexadecimal.
    pub network: Option<String>,
    /// How many entries were verified.
    pub entries: u64,
    /// How many checkpoints were verified.
    pub checkpoints: u64,
    /// Root of the last verified tree, in hexadecimal.
    pub root: Option<String>,
    /// Digest of the state after the last verified entry, in hexadecimal.
    pub state: Option<String>,
    /// The rules in force after the last verified entry.
    pub rules: Option<Rules>,
    /// Why the replay could not be saved, if that failed. The next replay then knows nothing of this one, and notices no rollback.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub unsaved: Option<String>,
    /// Why the replay could not read the ledger to its end: a disk failed, which says nothing about the ledger. It is among the findings.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub unread: Option<Finding>,
    /// The findings in the order of the entries, then what was not checked, and at last why the replay stopped, if it did.
    pub findings: Vec<Finding>,
}

impl Finding {
    /// A finding that makes the verdict [`Verdict::Failed`].
    pub fn fault(index: impl Into<Option<u64>>, text: impl Into<String>) -> Self {
        Self {
            index: index.into(),
            severity: Severity::Fault,
            text: text.into(),
        }
    }

    /// A finding that makes the verdict [`Verdict::Incomplete`] at best.
    pub fn not_checked(index: impl Into<Option<u64>>, text: impl Into<String>) -> Self {
        Self {
            severity: Severity::NotChecked,
            ..Self::fault(index, text)
        }
    }

    /// A finding that does not change the verdict.
    pub fn note(index: impl Into<Option<u64>>, text: impl Into<String>) -> Self {
        Self {
            severity: Severity::Note,
            ..Self::fault(index, text)
        }
    }
}

/// That a ledger cannot be verified any further is a fault, unless it just cannot be read.
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
