//! Removes checks from the copy of the workspace, one at a time.

use crate::Removal;
use std::collections::{BTreeMap, BTreeSet};
use std::fmt;
use std::path::Path;
use zk0_tests::changed_copy::{ChangedCopy, Ran};

/// The copy.
pub struct Copy(ChangedCopy);

/// What became of the test when the check was gone.
pub enum Outcome {
    /// It failed, as it should.
    Red,
    /// It passed, or did not run.
    NotRed,
    /// The check was not removed, or the copy does not build.
    NotTried(String),
}

impl fmt::Display for Outcome {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Red => f.write_str("the test fails without it"),
            Self::NotRed => f.write_str("no test fails without it, or the test has another name"),
            Self::NotTried(why) => write!(f, "not tried: {why}"),
        }
    }
}

impl Copy {
    /// Copies the sources of this workspace.
    pub fn of_workspace() -> Self {
        let ours = Path::new(env!("CARGO_TARGET_TMPDIR"));
        Self(ChangedCopy::of_workspace(ours, "deletions"))
    }

    /// Removes a check, runs the test, and puts the check back.
    pub fn without(&self, removal: &Removal) -> Outcome {
        let run =
            |copy: &ChangedCopy| copy.run(removal.package, removal.target, &[removal.test], &[]);
        let ran = match self.0.with(&removal.change(), run) {
            Ok(ran) => ran,
            Err(why) => return Outcome::NotTried(why),
        };
        match outcomes(&ran, removal.test).contains(&false) {
            true => Outcome::Red,
            false if ran.succeeded => Outcome::NotRed,
            false => Outcome::NotTried(ran.printed + &ran.errors),
        }
    }

    /// Runs the tests of `removals` on the copy as it is, and returns what is wrong with them: a test that fails here anyway, or that is
    /// not there, shows nothing when a check is gone. Tests of one file run together.
    pub fn unchanged(&self, removals: &[&Removal]) -> Vec<String> {
        let mut files = BTreeMap::<_, BTreeSet<_>>::new();
        for removal in removals {
            let file = (removal.package, removal.target);
            files.entry(file).or_default().insert(removal.test);
        }
        let mut wrong = vec![];
        for ((package, target), tests) in files {
            let tests: Vec<_> = tests.into_iter().collect();
            let ran = self.0.run(package, target, &tests, &[]);
            let passes = |test: &&str| matches!(outcomes(&ran, test)[..], [true, ..]);
            let fail = tests.iter().filter(|test| !passes(test));
            let fail: Vec<_> = fail.copied().collect();
            if !fail.is_empty() {
                let fail = fail.join(", ");
                wrong.push(format!(
                    "these tests of {package}, {target}, do not pass on the unchanged copy: {fail}\n{}{}",
                    ran.printed, ran.errors
                ));
            }
        }
        wrong
    }
}

/// Whether the test with this name passed, once for each module that has such a test; failures come first.
fn outcomes(ran: &Ran, test: &str) -> Vec<bool> {
    let of_the_test = ran.printed.lines().filter_map(|line| {
        let rest = line.strip_prefix("test ")?;
        let (name, outcome) = rest.split_once(" ... ")?;
        let name = name.trim_end_matches(" - should panic");
        let is_it = name.rsplit("::").next() == Some(test);
        (is_it && outcome != "ignored").then_some(outcome == "ok")
    });
    let mut outcomes: Vec<_> = of_the_test.collect();
    outcomes.sort();
    outcomes
}
