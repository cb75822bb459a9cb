//! What becomes of each attack when its defence is gone.
//!
//! The test makes a copy of the sources, in which all attacks have to be refused. Then it takes out one defence after the other, builds the
//! copy, and carries the attack out there. A build that fails, or another refusal, shows nothing: the attack has to succeed.

use crate::attack::{printed, Attack, Outcome};
use crate::scene::PROOF_OF_ANY_CLAIM;
use crate::table::ATTACKS;
use serde_json::{json, Value};
use std::path::Path;
use zk0_tests::changed_copy::{Change, ChangedCopy};

/// The rows that `ZK0_ATTACKS` names, for example `5;13`, or all.
fn chosen() -> Vec<Attack> {
    let chosen = std::env::var("ZK0_ATTACKS").unwrap_or_default();
    let numbers: Vec<u8> = chosen
        .split(';')
        .filter(|text| !text.is_empty())
        .map(|text| {
            text.parse()
                .expect("ZK0_ATTACKS has numbers of rows, as in 5;13")
        })
        .collect();
    let attacks = ATTACKS.into_iter();
    attacks
        .filter(|attack| numbers.is_empty() || numbers.contains(&attack.number))
        .collect()
}

/// What becomes of attacks in the copy with these changes. Whatever is not an outcome is said instead.
fn carried_out(
    copy: &ChangedCopy,
    changes: &[Change],
    attacks: &[Attack],
) -> Vec<Result<Outcome, String>> {
    if attacks.is_empty() {
        return vec![];
    }
    let tests: Vec<_> = attacks.iter().map(Attack::test).collect();
    let mut arguments: Vec<_> = tests.iter().map(String::as_str).collect();
    arguments.extend(["--exact", "--nocapture", "--test-threads", "1"]);
    let ran = copy.with(changes, |copy| copy.run("zk0-tests", "attacks", &arguments));
    let outcome = |attack: &Attack| {
        let ran = ran.as_ref().map_err(String::clone)?;
        let not_tried = || format!("not tried: {}{}", ran.printed, ran.errors);
        printed(attack, &ran.printed).ok_or_else(not_tried)
    };
    attacks.iter().map(outcome).collect()
}

/// The words of the refusal, if the attack is refused for its own reason.
fn refused(attack: &Attack, outcome: Result<Outcome, String>) -> Result<String, String> {
    match outcome? {
        Outcome::Refused(reason) if reason.contains(attack.reason) => Ok(reason),
        other => Err(format!("{other:?}, and not: {}", attack.reason)),
    }
}

/// What is changed for attackers who can prove their claims.
fn with_proofs(proves: bool) -> &'static [Change] {
    match proves {
        true => PROOF_OF_ANY_CLAIM.out,
        false => &[],
    }
}

/// What the attack is refused for, what is taken out, and what the attacker has got then.
fn row(attack: &Attack, refused: String, copy: &ChangedCopy) -> Result<Value, String> {
    let changes = [with_proofs(attack.proves), attack.defence.out].concat();
    let mut outcome = carried_out(copy, &changes, std::slice::from_ref(attack));
    match outcome.remove(0)? {
        Outcome::Succeeded(what) => Ok(json!({
            "attack": attack.number,
            "name": attack.name,
            "refused": refused,
            "without": attack.defence.check,
            "then": what,
        })),
        Outcome::Refused(reason) => Err(format!(
            "without the defence, the attack is still refused: {reason}"
        )),
    }
}

#[test]
#[ignore = "builds the copy for each attack: make attacks"]
fn every_attack_succeeds_without_its_defence() {
    let attacks = chosen();
    let copy = ChangedCopy::of_workspace(Path::new(env!("CARGO_TARGET_TMPDIR")), "attacks");
    let unchanged = carried_out(&copy, &[], &attacks);
    // An attacker who can prove its claim is refused all the same, for the same reason.
    let proving: Vec<_> = attacks
        .iter()
        .filter(|attack| attack.proves)
        .copied()
        .collect();
    let mut proven = carried_out(&copy, with_proofs(true), &proving).into_iter();
    let mut hold = 0;
    for (attack, outcome) in attacks.iter().zip(unchanged) {
        let refused = refused(attack, outcome).and_then(|reason| match attack.proves {
            true => refused(attack, proven.next().expect("there is one for each")),
            false => Ok(reason),
        });
        let shown = refused.and_then(|reason| row(attack, reason, &copy));
        match shown {
            Ok(line) => {
                println!("{line}");
                hold += 1;
            }
            Err(why) => println!(
                "{}",
                json!({"attack": attack.number, "name": attack.name, "wrong": why})
            ),
        }
    }
    println!("{}", json!({"attacks": attacks.len(), "hold": hold}));
    assert_eq!(hold, attacks.len(), "of these attacks hold");
}
