//! What an attack is, and what became of it.

use serde_json::{json, Value};
use std::future::Future;
use tokio::runtime::Runtime;
use tonic::Status;
use zk0_testkit::changed_copy::SourceChange;

/// What became of an attack.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Outcome {
    /// It was refused, with this reason.
    Refused(String),
    /// It succeeded. The text states what the attacker has got.
    Succeeded(String),
}

/// A check that stops attacks, or several that each stop the same attack.
#[derive(Clone, Copy, Debug)]
pub struct Defence {
    /// What it does, in words.
    pub check: &'static str,
    /// How the sources get a switch that takes it out: the new code has `OUT` where the switch is asked ([`zk0_testkit::changed_copy::switched`]).
    pub out: &'static [SourceChange],
}

/// What an attack needs of a proof. This test cannot make one: it takes a quarter of an hour. Where the attacker could, it is given one in the
/// copy ([`super::scene::PROOF_OF_ANY_CLAIM`]), which alone must not be enough.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Proof {
    /// None.
    NotNeeded,
    /// A proof of its claim. The attack is refused before anybody looks at the proof, so its reason is the same without one.
    SeenLater,
    /// A proof of its claim, which is verified first. Without one, the attack is refused for that.
    SeenFirst,
}

/// Why a claim is refused that comes with the proof of another one.
pub const UNPROVEN: &str = "the SP1 proof does not prove this claim";

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
    /// Whether the attacker has to prove its claim.
    pub proof: Proof,
    /// What stops the attack.
    pub defence: Defence,
    /// Carries the attack out.
    pub carry_out: fn() -> Outcome,
}

/// What stands before the line that a program reads.
pub const MARK: &str = "attack: ";

impl Attack {
    /// Carries the attack out, prints what became of it for [`super::counter`], and demands that it was refused for its own reason.
    pub fn is_refused(&self) {
        let outcome = (self.carry_out)();
        // What cargo prints about a test may stand in front of it on the same line.
        println!("\n{MARK}{}", self.line(&outcome));
        match outcome {
            Outcome::Refused(reason) => {
                let unproven = self.proof == Proof::SeenFirst && reason.contains(UNPROVEN);
                let own = reason.contains(self.reason);
                assert!(own || unproven, "another reason: {reason}");
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

    /// The module of the attack within this program of tests. Its defence has this name, too.
    pub fn path(&self) -> &'static str {
        let (_, path) = self.module.split_once("::").unwrap_or_default();
        path
    }

    /// The test of the attack, as it is called in this program of tests.
    pub fn test(&self) -> String {
        format!("{}::it_is_refused", self.path())
    }
}

/// What a run of [`Attack::is_refused`] printed about this attack.
pub fn printed(attack: &Attack, text: &str) -> Option<Outcome> {
    let lines = text.lines().filter_map(|line| line.strip_prefix(MARK));
    let mut lines = lines.filter_map(|line| serde_json::from_str::<Value>(line).ok());
    let line = lines.find(|line| line["test"] == attack.test())?;
    let reported = |key: &str| line[key].as_str().map(str::to_owned);
    reported("refused")
        .map(Outcome::Refused)
        .or(reported("succeeded").map(Outcome::Succeeded))
}

/// Carries out an attack over the network.
pub fn over_the_network(attack: impl Future<Output = Outcome>) -> Outcome {
    Runtime::new().unwrap().block_on(attack)
}

/// The answer to an attack that has succeeded if the service states yes.
pub fn answered<T>(answer: Result<T, Status>, won: impl FnOnce(T) -> String) -> Outcome {
    match answer {
        Ok(answer) => Outcome::Succeeded(won(answer)),
        Err(status) => Outcome::Refused(status.message().into()),
    }
}
