//! What an audit checked and left out.

use borsh::{BorshDeserialize, BorshSerialize};
use serde::Serialize;
use std::collections::BTreeMap;
use zk0_ledger::replay::Finding;
use zk0_protocol::counted::counted;

/// A kind of check.
#[derive(
    Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, BorshSerialize, BorshDeserialize,
)]
#[serde(rename_all = "kebab-case")]
pub enum CheckKind {
    /// The guest program is this release's, or the auditor's.
    Program,
    /// The evaluation's parameters are this release's, or the auditor's.
    Evaluation,
    /// The file of the initial policy is the genesis's.
    Policy,
    /// A dataset's leaves hash to the committed root, and all differ.
    Datasets,
    /// A round's starting weights file holds the ledger's numbers.
    Bases,
    /// An accepted contribution's SP1 proof verifies.
    Proofs,
    /// An update's bytes are the proven weights, and have the proof's products.
    Updates,
    /// Verification gives a refusal's recorded reason.
    Refusals,
    /// The average, computed again, is as recorded.
    Averages,
    /// A round's result has the recorded losses on the public samples, and outcome.
    Results,
    /// The file of global weights is the ledger's.
    Globals,
    /// The file of a round's moments is the ledger's.
    Moments,
    /// Verification decides a dispute as recorded.
    Disputes,
}

/// Why a check was left out.
#[derive(
    Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, BorshSerialize, BorshDeserialize,
)]
#[serde(rename_all = "kebab-case")]
pub enum SkipReason {
    /// A light audit reads no weights or frame lists.
    Light,
    /// A blob for the check is missing.
    NotAtHand,
    /// A blob for the check is missing, and its pruning is signed.
    Pruned,
    /// The check needs an unverified part.
    RestsOnOthers,
    /// The network's founder chose something unknown to this release.
    OthersChoice,
    /// This release has no verifier for the proof's SP1 release.
    NoVerifier,
}

/// How much was checked.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Checked {
    /// Datasets whose leaves hash to the committed root and all differ.
    pub datasets: u64,
    /// Verified proofs of accepted contributions.
    pub proofs: u64,
    /// Updates whose bytes are the proven weights.
    pub updates: u64,
    /// Refusals whose reason verification gives.
    pub refusals: u64,
    /// Global weights with the same digest, computed again.
    pub averages: u64,
    /// Results of rounds with the recorded losses on the public samples.
    pub results: u64,
    /// Disputes that verification decides as recorded.
    pub disputes: u64,
    /// Checks left out.
    pub not_checked: u64,
}

/// Checks of one kind, left out for one reason.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct NotChecked {
    /// The kind of check.
    pub what: CheckKind,
    /// The reason.
    pub why: SkipReason,
    /// Number of checks.
    pub count: u64,
    /// The first one's entry.
    pub first_entry: u64,
    /// What it would have checked.
    pub example: String,
}

/// What was checked and left out so far.
#[derive(Clone, Debug, Default, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct Account {
    passed: BTreeMap<CheckKind, u64>,
    left_out: BTreeMap<(CheckKind, SkipReason), (u64, u64, String)>,
}

impl Account {
    /// Counts a passed check.
    pub fn passed(&mut self, what: CheckKind) {
        *self.passed.entry(what).or_default() += 1;
    }

    /// Counts a check of entry `index` left out.
    pub fn left_out(&mut self, what: CheckKind, why: SkipReason, index: u64, example: String) {
        let place = self.left_out.entry((what, why));
        place.or_insert((0, index, example)).0 += 1;
    }

    /// Adds a later account.
    pub fn add(&mut self, later: Self) {
        for (what, count) in later.passed {
            *self.passed.entry(what).or_default() += count;
        }
        for (kind, (count, index, example)) in later.left_out {
            self.left_out.entry(kind).or_insert((0, index, example)).0 += count;
        }
    }

    /// How much was checked.
    pub fn checked(&self) -> Checked {
        let count = |what| self.passed.get(&what).copied().unwrap_or_default();
        Checked {
            datasets: count(CheckKind::Datasets),
            proofs: count(CheckKind::Proofs),
            updates: count(CheckKind::Updates),
            refusals: count(CheckKind::Refusals),
            averages: count(CheckKind::Averages),
            results: count(CheckKind::Results),
            disputes: count(CheckKind::Disputes),
            not_checked: self.left_out.values().map(|(count, ..)| count).sum(),
        }
    }

    /// What was left out, by kind and reason.
    pub fn not_checked(&self) -> Vec<NotChecked> {
        let line = |(&(what, why), (count, index, example)): (
            &(CheckKind, SkipReason),
            &(u64, u64, String),
        )| {
            NotChecked {
                what,
                why,
                count: *count,
                first_entry: *index,
                example: example.clone(),
            }
        };
        self.left_out.iter().map(line).collect()
    }
}

impl NotChecked {
    /// The report's finding.
    pub fn finding(&self) -> Finding {
        Finding::not_checked(None, self.to_string())
    }
}

impl std::fmt::Display for NotChecked {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let (one, many) = match self.what {
            CheckKind::Program => ("guest program", "guest programs"),
            CheckKind::Evaluation => ("evaluation's parameters", "evaluations' parameters"),
            CheckKind::Policy => ("initial policy", "initial policies"),
            CheckKind::Datasets => (
                "dataset's list of drawn frames",
                "datasets' lists of drawn frames",
            ),
            CheckKind::Bases => (
                "file of weights that a round starts from",
                "files of weights that rounds start from",
            ),
            CheckKind::Proofs if self.why == SkipReason::NotAtHand => (
                "accepted contribution's proof in the open round",
                "accepted contributions' proofs in the open round",
            ),
            CheckKind::Proofs => (
                "accepted contribution's proof",
                "accepted contributions' proofs",
            ),
            CheckKind::Updates => ("update's weights", "updates' weights"),
            CheckKind::Refusals => ("refusal's reason", "refusals' reasons"),
            CheckKind::Averages => ("average", "averages"),
            CheckKind::Results => (
                "evaluation of a round's result",
                "evaluations of rounds' results",
            ),
            CheckKind::Globals => ("file of global weights", "files of global weights"),
            CheckKind::Moments => ("file of a round's moments", "files of rounds' moments"),
            CheckKind::Disputes => ("decision of a dispute", "decisions of disputes"),
        };
        write!(f, "{}: ", counted(self.count, one, many))?;
        match self.why {
            SkipReason::Light => f.write_str("this audit is light"),
            SkipReason::Pruned => {
                let first = if self.count == 1 { "" } else { "the first, " };
                write!(
                    f,
                    "the log's operator has pruned what this needs; {first}{} (entry {})",
                    self.example, self.first_entry
                )
            }
            SkipReason::NotAtHand
            | SkipReason::RestsOnOthers
            | SkipReason::OthersChoice
            | SkipReason::NoVerifier => {
                let first = if self.count == 1 { "" } else { "the first, " };
                write!(f, "{first}{} (entry {})", self.example, self.first_entry)
            }
        }
    }
}
