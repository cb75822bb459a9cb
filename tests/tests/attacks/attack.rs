//! What an attack is, and what became of it.

use serde_json::{json, Value};
use std::future::Future;
use tokio::runtime::Runtime;
use tonic::Status;
use zk0_tests::changed_copy::Change;

/// What became of an attack.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Outcome {
    /// It was refused, with this reason.
    Refused(String),
    /// It succeeded. The text says what the attacker has got.
    Succeeded(String),
}

/// A check that stops attacks, or several that each stop the same attack.
#[derive(Clone, Copy, Debug)]
pub struct Defence {
    /// What it does, in words.
    pub check: &'static str,
    /// How it is taken out of the sources.
    pub out: &'static [Change],
}

/// An attack of the table.
#[derive(Clone, Copy)]
pub struct Attack {
    /// The row of the table.
    pub number: u8,
    /// What the attacker does, in words.
    pub name: &'static str,
    /// The module of the attack, `module_path!()`.
    pub module: &'static str,
    /// Words of the reason for which it is refused.
    pub reason: &'static str,
    /// Whether the attacker could prove its claim, as this test cannot ([`crate::scene::PROOF_OF_ANY_CLAIM`]). The proof alone must not be
    /// enough.
    pub proves: bool,
    /// What stops the attack.
    pub defence: Defence,
    /// Carries the attack out.
    pub carry_out: fn() -> Outcome,
}

/// What stands before the line that a program reads.
pub const MARK: &str = "attack: ";

impl Attack {
    /// Carries the attack out, prints what became of it for [`crate::counter`], and demands that it was refused for its own reason.
    pub fn is_refused(&self) {
        let outcome = (self.carry_out)();
        // What cargo prints about a test may stand in front of it on the same line.
        println!("\n{MARK}{}", self.line(&outcome));
        match outcome {
            Outcome::Refused(reason) => {
                assert!(reason.contains(self.reason), "another reason: {reason}");
            }
            Outcome::Succeeded(what) => panic!("the attack succeeded: {what}"),
        }
    }

    fn line(&self, outcome: &Outcome) -> Value {
        match outcome {
            Outcome::Refused(reason) => json!({"test": self.test(), "refused": reason}),
            Outcome::Succeeded(what) => json!({"test": self.test(), "succeeded": what}),
        }
    }

    /// The test of the attack, as it is called in this file of tests.
    pub fn test(&self) -> String {
        let (_, module) = self.module.split_once("::").unwrap_or_default();
        format!("{module}::it_is_refused")
    }
}

/// What a run of [`Attack::is_refused`] printed about this attack.
pub fn printed(attack: &Attack, text: &str) -> Option<Outcome> {
    let lines = text.lines().filter_map(|line| line.strip_prefix(MARK));
    let mut lines = lines.filter_map(|line| serde_json::from_str::<Value>(line).ok());
    let line = lines.find(|line| line["test"] == attack.test())?;
    let said = |key: &str| line[key].as_str().map(str::to_owned);
    said("refused")
        .map(Outcome::Refused)
        .or(said("succeeded").map(Outcome::Succeeded))
}

/// Carries out an attack over the network.
pub fn over_the_network(attack: impl Future<Output = Outcome>) -> Outcome {
    Runtime::new().unwrap().block_on(attack)
}

/// The answer to an attack that has succeeded if the service says yes.
pub fn answered<T>(answer: Result<T, Status>, won: impl FnOnce(T) -> String) -> Outcome {
    match answer {
        Ok(answer) => Outcome::Succeeded(won(answer)),
        Err(status) => Outcome::Refused(status.message().into()),
    }
}
