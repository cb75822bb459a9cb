//! What an audit checked, and what it did not check: the number of checks of each kind, and one line for each kind that was left out.

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
    /// The guest program is the one of this release, or one that the auditor named.
    Program,
    /// The parameters of the evaluation are those of this release, or some that the auditor named.
    Evaluation,
    /// The file of the whole initial policy is the one that the genesis names.
    Policy,
    /// The leaves of a dataset hash to the committed root, and no two are the same.
    Datasets,
    /// The file of the weights that a round starts from holds the numbers that the ledger names.
    Bases,
    /// The SP1 proof of an accepted contribution verifies.
    Proofs,
    /// The bytes of an update are the weights that were proven, and the proof's products are those with them.
    Updates,
    /// The recorded reason of a refusal is the one that verification gives.
    Refusals,
    /// An average, computed again, is the recorded one.
    Averages,
    /// A round's result, evaluated again on the public samples, has the recorded losses and outcome.
    Results,
    /// The file of global weights is the one that the ledger names.
    Globals,
    /// The file of a round's moments is the one that the ledger names.
    Moments,
    /// A dispute that verification decides was decided rightly.
    Disputes,
}

/// Why a check was left out.
#[derive(
    Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, BorshSerialize, BorshDeserialize,
)]
#[serde(rename_all = "kebab-case")]
pub enum SkipReason {
    /// The audit is light: it reads no weights and no lists of drawn frames.
    Light,
    /// A blob that the check reads is not at hand.
    NotAtHand,
    /// A blob that the check reads is not at hand, and the log's operator has signed that it was pruned.
    Pruned,
    /// The check needs something that was not verified.
    RestsOnOthers,
    /// The network's founder chose something that this release does not know.
    OthersChoice,
    /// This release has no verifier of the SP1 release that the proof is of.
    NoVerifier,
}

/// How much was checked.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Checked {
    /// Datasets whose leaves hash to the committed root, with no two the same.
    pub datasets: u64,
    /// Proofs of accepted contributions that verify.
    pub proofs: u64,
    /// Updates whose bytes are the weights that were proven.
    pub updates: u64,
    /// Refusals whose reason is the one that verification gives.
    pub refusals: u64,
    /// Global weights that have the same digest when they are computed again.
    pub averages: u64,
    /// Results of rounds whose losses on the public samples are the recorded ones when they are computed again.
    pub results: u64,
    /// Disputes that were decided as verification decides them here.
    pub disputes: u64,
    /// Checks that were left out.
    pub not_checked: u64,
}

/// Checks of one kind that were left out for one reason.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct NotChecked {
    /// The kind of check.
    pub what: CheckKind,
    /// The reason.
    pub why: SkipReason,
    /// How many checks.
    pub count: u64,
    /// The entry of the first of them.
    pub first_entry: u64,
    /// What the first of them would have checked.
    pub example: String,
}

/// What was checked and left out so far.
#[derive(Clone, Debug, Default, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct Account {
    passed: BTreeMap<CheckKind, u64>,
    left_out: BTreeMap<(CheckKind, SkipReason), (u64, u64, String)>,
}

impl Account {
    /// Counts a check that passed.
    pub fn passed(&mut self, what: CheckKind) {
        *self.passed.entry(what).or_default() += 1;
    }

    /// Counts a check of entry `index` that was left out.
    pub fn left_out(&mut self, what: CheckKind, why: SkipReason, index: u64, example: String) {
        let place = self.left_out.entry((what, why));
        place.or_insert((0, index, example)).0 += 1;
    }

    /// Adds what another account counted later.
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

    /// What was left out, a line for each kind and reason.
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
    /// The finding in the report.
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
