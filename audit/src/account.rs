//! What an audit checked, and what it did not: counts by kind, and one line for each kind that is missing.

use borsh::{BorshDeserialize, BorshSerialize};
use serde::Serialize;
use std::collections::BTreeMap;
use zk0_ledger::replay::Finding;

/// What is checked.
#[derive(
    Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, BorshSerialize, BorshDeserialize,
)]
#[serde(rename_all = "kebab-case")]
pub enum What {
    /// The file of the whole initial policy is the one that the genesis names.
    Policy,
    /// Leaves hash to the committed root, all different.
    Datasets,
    /// The weights that a round starts from: file and numbers belong together.
    Bases,
    /// SP1 proofs of accepted contributions.
    Proofs,
    /// Updates: the bytes are the weights that were proven, and the products are those with them.
    Updates,
    /// Reasons of refusals.
    Refusals,
    /// Averages, computed anew.
    Averages,
    /// Files of global weights are those that the ledger names.
    Globals,
    /// Disputes that verification decided.
    Disputes,
}

/// Why something is not checked.
#[derive(
    Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, BorshSerialize, BorshDeserialize,
)]
#[serde(rename_all = "kebab-case")]
pub enum Why {
    /// A light audit reads no weights and no lists of samples.
    Light,
    /// A blob is not here.
    NotAtHand,
    /// It rests on something that was not verified.
    RestsOnOthers,
}

/// How much was checked.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Checked {
    /// Datasets whose leaves hash to the committed root, all different.
    pub datasets: u64,
    /// Proofs of accepted contributions that verify.
    pub proofs: u64,
    /// Updates whose bytes are the weights that were proven.
    pub updates: u64,
    /// Refusals that were found to be right.
    pub refusals: u64,
    /// Global weights computed anew, with the same digest.
    pub averages: u64,
    /// Disputes that verification decided as it does here.
    pub disputes: u64,
    /// Checks that were left out.
    pub not_checked: u64,
}

/// Checks of one kind that were left out for one reason.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct NotChecked {
    /// What.
    pub what: What,
    /// Why.
    pub why: Why,
    /// How many.
    pub count: u64,
    /// The first of them: its entry.
    pub first_entry: u64,
    /// The first of them, in words.
    pub example: String,
}

/// A running account.
#[derive(Clone, Debug, Default, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct Account {
    passed: BTreeMap<What, u64>,
    left_out: BTreeMap<(What, Why), (u64, u64, String)>,
}

impl Account {
    /// One more check that passed.
    pub fn passed(&mut self, what: What) {
        *self.passed.entry(what).or_default() += 1;
    }

    /// One more check that was left out, at entry `index`.
    pub fn left_out(&mut self, what: What, why: Why, index: u64, example: String) {
        let place = self.left_out.entry((what, why));
        place.or_insert((0, index, example)).0 += 1;
    }

    /// Takes over what another one counted later.
    pub fn add(&mut self, later: Self) {
        for (what, count) in later.passed {
            *self.passed.entry(what).or_default() += count;
        }
        for (kind, (count, index, example)) in later.left_out {
            self.left_out.entry(kind).or_insert((0, index, example)).0 += count;
        }
    }

    /// The counts.
    pub fn checked(&self) -> Checked {
        let count = |what| self.passed.get(&what).copied().unwrap_or_default();
        Checked {
            datasets: count(What::Datasets),
            proofs: count(What::Proofs),
            updates: count(What::Updates),
            refusals: count(What::Refusals),
            averages: count(What::Averages),
            disputes: count(What::Disputes),
            not_checked: self.left_out.values().map(|(count, ..)| count).sum(),
        }
    }

    /// What was left out, a line for each kind and reason.
    pub fn not_checked(&self) -> Vec<NotChecked> {
        let line =
            |(&(what, why), (count, index, example)): (&(What, Why), &(u64, u64, String))| {
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
    /// For the report.
    pub fn finding(&self) -> Finding {
        Finding::note(None, format!("not checked: {self}"))
    }
}

impl std::fmt::Display for NotChecked {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let (one, many) = match self.what {
            What::Policy => ("initial policy", "initial policies"),
            What::Datasets => ("dataset's list of samples", "datasets' lists of samples"),
            What::Bases => (
                "file of weights that a round starts from",
                "files of weights that rounds start from",
            ),
            What::Proofs => ("proof in the open round", "proofs in the open round"),
            What::Updates => ("update's weights", "updates' weights"),
            What::Refusals => ("refusal's reason", "refusals' reasons"),
            What::Averages => ("average", "averages"),
            What::Globals => ("file of global weights", "files of global weights"),
            What::Disputes => ("decision of a dispute", "decisions of disputes"),
        };
        let noun = if self.count == 1 { one } else { many };
        write!(f, "{} {noun}: ", self.count)?;
        match self.why {
            Why::Light => f.write_str("this audit is light"),
            Why::NotAtHand | Why::RestsOnOthers => {
                let first = if self.count == 1 { "" } else { "the first, " };
                write!(f, "{first}{} (entry {})", self.example, self.first_entry)
            }
        }
    }
}
