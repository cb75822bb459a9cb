//! The strategy SCAFFOLD states how all nodes train, because control variates follow from the ledger only then.

use zk0_protocol::rules::network_rules::{Scaffold, Strategy};
use zk0_testkit::network::*;

fn scaffold(steps: u32, learning_rate_millionths: u32, restart_rounds: u32) -> Scaffold {
    Scaffold {
        steps,
        learning_rate_millionths,
        restart_rounds,
    }
}

fn check(scaffold: Scaffold) -> Result<(), String> {
    let mut rules = genesis().rules;
    rules.strategy = Strategy::Scaffold(scaffold);
    rules.check()
}

#[test]
fn scaffold_can_be_written_in_a_file_of_rules() {
    let text = r#"{"scaffold":{"steps":600,"learning_rate_millionths":20000,"restart_rounds":20}}"#;
    let strategy = Strategy::Scaffold(scaffold(600, 20_000, 20));
    assert_eq!(serde_json::to_string(&strategy).unwrap(), text);
    assert_eq!(serde_json::from_str::<Strategy>(text).unwrap(), strategy);
    assert_eq!(check(scaffold(600, 20_000, 20)), Ok(()));
    // The limits themselves are allowed.
    assert_eq!(check(scaffold(1, 1, 1)), Ok(()));
    assert_eq!(check(scaffold(1_000_000, 100_000_000, 1_000)), Ok(()));
}

#[test]
fn scaffold_by_which_nobody_could_train_founds_nothing() {
    for (scaffold, wrong) in [
        (scaffold(0, 1, 1), "steps 0; it has to be 1 to 1000000"),
        (scaffold(1_000_001, 1, 1), "steps 1000001"),
        (
            scaffold(1, 0, 1),
            "learning_rate_millionths 0; it has to be 1 to 100000000",
        ),
        (
            scaffold(1, 100_000_001, 1),
            "learning_rate_millionths 100000001",
        ),
        (
            scaffold(1, 1, 0),
            "restart_rounds 0; it has to be 1 to 1000",
        ),
        (scaffold(1, 1, 1_001), "restart_rounds 1001"),
    ] {
        let why = check(scaffold).unwrap_err();
        assert!(
            why.starts_with("rule strategy has ") && why.contains(wrong),
            "{why}"
        );
    }
}

#[test]
fn control_variates_begin_again_after_a_number_of_rounds() {
    let rule = scaffold(1, 2_500_000, 4);
    let begins: Vec<_> = (0..10).map(|round| rule.begins(round)).collect();
    assert_eq!(begins, [0, 0, 0, 0, 4, 4, 4, 4, 8, 8]);
    assert_eq!(scaffold(1, 1, 1).begins(7), 7, "they are always 0");
    assert_eq!(rule.learning_rate(), 2.5);
}
