//! What a replay says: findings, and whether the history is what it claims to be.

use borsh::{BorshDeserialize, BorshSerialize};
use serde::Serialize;
use zk0_protocol::rules::network_rules::Rules;

/// Something an auditor should know.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, BorshSerialize, BorshDeserialize)]
pub struct Finding {
    /// The entry it is about.
    pub index: Option<u64>,
    /// Whether the ledger cannot be trusted because of it.
    pub severity: Severity,
    /// In words.
    pub text: String,
}

/// How bad a finding is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, BorshSerialize, BorshDeserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Severity {
    /// Something could not be checked, or deserves a look.
    Note,
    /// Something is wrong: the verdict is [`Verdict::Failed`].
    Fault,
}

/// Whether the history is what it claims to be.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Verdict {
    /// Nothing is wrong.
    Verified,
    /// Something is: see the findings.
    Failed,
}

/// What a replay found.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Report {
    /// Whether it holds.
    pub verdict: Verdict,
    /// The network's name, once the genesis was read.
    pub name: Option<String>,
    /// The network's id, in hexadecimal.
    pub network: Option<String>,
    /// Entries verified.
    pub entries: u64,
    /// Checkpoints verified.
    pub checkpoints: u64,
    /// Root of the last verified tree, in hexadecimal.
    pub root: Option<String>,
    /// Digest of the state after the last verified entry, in hexadecimal.
    pub state: Option<String>,
    /// The rules in force after it.
    pub rules: Option<Rules>,
    /// What was found, in the order of the entries; then what was not checked; and at last, if the replay stopped, why.
    pub findings: Vec<Finding>,
}

impl Finding {
    /// Something that makes the replay fail.
    pub fn fault(index: impl Into<Option<u64>>, text: impl Into<String>) -> Self {
        Self {
            index: index.into(),
            severity: Severity::Fault,
            text: text.into(),
        }
    }

    /// Something worth knowing.
    pub fn note(index: impl Into<Option<u64>>, text: impl Into<String>) -> Self {
        Self {
            severity: Severity::Note,
            ..Self::fault(index, text)
        }
    }
}
