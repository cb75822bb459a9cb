//! Checks of the moments that rounds by FedAdam end with.

use crate::ledger_rules::rule;
use crate::Removal;

const MOMENTS: &str = "protocol/src/rules/apply/moments.rs";

pub const REMOVALS: &[Removal] = &[
    rule(
        "a round by FedAdam names its moments before it closes",
        "protocol/src/rules/apply/rounds.rs",
        &[("        self.check_closed_moments(round, closed)?;\n", "")],
        "a_round_by_fed_adam_cannot_close_without_its_moments",
    ),
    rule(
        "moments are named when the round may close",
        MOMENTS,
        &[("        self.check_may_close(round, time_ms)?;\n", "        let _ = time_ms;\n")],
        "moments_are_named_once_and_only_when_the_round_may_close",
    ),
    rule(
        "moments are named once",
        MOMENTS,
        &[("if let Some(before) = &round.moments {", "if let Some(before) = round.moments.as_ref().filter(|_| false) {")],
        "moments_are_named_once_and_only_when_the_round_may_close",
    ),
    rule(
        "other strategies have no moments",
        MOMENTS,
        &[("match self.by_fed_adam() && !self.contributors().is_empty() {", "match true {")],
        "other_strategies_and_rounds_without_contributors_have_no_moments",
    ),
    rule(
        "a result that is not taken leaves no moments",
        MOMENTS,
        &[("            (Some(moments), false) => Err(wrong(", "            (Some(_), false) => Ok(()),\n            #[allow(unreachable_patterns)]\n            (Some(moments), false) => Err(wrong(")],
        "a_round_that_keeps_its_base_keeps_its_moments",
    ),
    Removal {
        target: "voting",
        ..rule(
            "restored weights have no moments",
            "protocol/src/rules/apply/votes.rs",
            &[("                    self.moments = None;\n", "")],
            "restored_weights_have_no_moments",
        )
    },
    Removal {
        target: "voting",
        ..rule(
            "another strategy keeps no moments",
            MOMENTS,
            &[("            self.moments = None;\n", "")],
            "restored_weights_have_no_moments",
        )
    },
];
