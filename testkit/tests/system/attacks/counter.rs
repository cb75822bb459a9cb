//! What becomes of each attack when its defence is gone.
//!
//! The test makes a copy of the sources, and gives each defence in it a switch that takes it out at run time. So one build is enough. In the
//! copy, each attack is carried out three times: with all defences, where it has to be refused; where the attacker needs a proof, with that
//! proof, where it has to be refused for its own reason; and without the defence, where it has to **succeed**. Another refusal shows nothing.

use super::attack::{printed, Attack, Outcome, Proof, UNPROVEN};
use super::scene::PROOF_OF_ANY_CLAIM;
use super::table::ATTACKS;
use serde_json::{json, Value};
use std::collections::BTreeMap;
use std::path::Path;
use zk0_testkit::changed_copy::{switched, ChangedCopy, SourceChange, OUT};

/// The name of the switch that gives attackers a proof of their claim.
const PROOF: &str = "PROOF";

/// The attacks of the rows that `ZK0_ATTACKS` names, as in `5;13`, or all.
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
    let chosen = ATTACKS
        .iter()
        .filter(|attack| numbers.is_empty() || numbers.contains(&attack.number));
    chosen.copied().collect()
}

/// A copy of the sources in which each defence has a switch.
fn with_switches() -> ChangedCopy {
    let copy = ChangedCopy::of_workspace(Path::new(env!("CARGO_TARGET_TMPDIR")), "attacks");
    let put = |name: &str, changes: &[SourceChange]| {
        for change in changes {
            let asked = |code: &str| switched(code, name);
            let done = copy.edit(change.file, |source| change.applied_with(source, asked));
            done.expect("the test of the table states that it fits");
        }
    };
    put(PROOF, PROOF_OF_ANY_CLAIM.out);
    for attack in ATTACKS.iter().filter(|attack| !is_the_proof(attack)) {
        put(attack.path(), attack.defence.out);
    }
    copy
}

/// Whether the defence against an attack is that proofs prove the claims that they come with.
fn is_the_proof(attack: &Attack) -> bool {
    attack.defence.check == PROOF_OF_ANY_CLAIM.check
}

/// What becomes of attacks without these defences.
fn carried_out(
    copy: &ChangedCopy,
    without: &[&str],
    attacks: &[Attack],
) -> Vec<Result<Outcome, String>> {
    if attacks.is_empty() {
        return vec![];
    }
    let tests: Vec<_> = attacks.iter().map(Attack::test).collect();
    let mut arguments: Vec<_> = tests.iter().map(String::as_str).collect();
    arguments.extend(["--exact", "--nocapture", "--test-threads", "1"]);
    let without = [(OUT, &without.join(";")[..])];
    let ran = copy.run("zk0-testkit", "system", &arguments, &without);
    let outcome = |attack: &Attack| {
        let not_tried = || format!("not tried: {}{}", ran.printed, ran.errors);
        printed(attack, &ran.printed).ok_or_else(not_tried)
    };
    attacks.iter().map(outcome).collect()
}

/// The words of the refusal, if the attack is refused for this reason.
fn refused(expected: &str, outcome: Result<Outcome, String>) -> Result<String, String> {
    match outcome? {
        Outcome::Refused(reason) if reason.contains(expected) => Ok(reason),
        other => Err(format!("{other:?}, and not: {expected}")),
    }
}

/// What the attack is refused for, what is taken out, and what the attacker has got then.
fn row(attack: &Attack, refused: String, copy: &ChangedCopy) -> Result<Value, String> {
    let without: &[&str] = match attack.proof {
        _ if is_the_proof(attack) => &[PROOF],
        Proof::NotNeeded => &[attack.path()],
        Proof::SeenLater | Proof::SeenFirst => &[PROOF, attack.path()],
    };
    let mut outcome = carried_out(copy, without, std::slice::from_ref(attack));
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
#[ignore = "builds a copy of the sources: make attacks"]
fn every_attack_succeeds_without_its_defence() {
    let attacks = chosen();
    let copy = with_switches();
    let with_all = carried_out(&copy, &[], &attacks);
    // An attacker who can prove its claim is refused all the same.
    let proving = attacks.iter().filter(|one| one.proof != Proof::NotNeeded);
    let proving: Vec<_> = proving.copied().collect();
    let mut proven = carried_out(&copy, &[PROOF], &proving).into_iter();
    let mut proven = || proven.next().expect("there is one for each");
    let mut held = BTreeMap::<u8, bool>::new();
    for (attack, outcome) in attacks.iter().zip(with_all) {
        let own = attack.reason;
        let refused = match attack.proof {
            Proof::NotNeeded => refused(own, outcome),
            Proof::SeenLater => refused(own, outcome).and(refused(own, proven())),
            Proof::SeenFirst => refused(UNPROVEN, outcome).and(refused(own, proven())),
        };
        let shown = refused.and_then(|reason| row(attack, reason, &copy));
        *held.entry(attack.number).or_insert(true) &= shown.is_ok();
        let line = shown.unwrap_or_else(
            |why| json!({"attack": attack.number, "name": attack.name, "wrong": why}),
        );
        println!("{line}");
    }
    let hold = held.values().filter(|held| **held).count();
    println!(
        "{}",
        json!({"rows": held.len(), "hold": hold, "attacks": attacks.len()})
    );
    assert_eq!(hold, held.len(), "so many rows hold");
}
