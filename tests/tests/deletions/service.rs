//! Checks of the service: what arrived in time counts, nobody is held up by others, and nobody fills its memory.

use crate::Removal;

const fn in_time(
    check: &'static str,
    file: &'static str,
    replacements: &'static [(&'static str, &'static str)],
    test: &'static str,
) -> Removal {
    Removal {
        check,
        file,
        replacements,
        package: "zk0-aggregator",
        target: "in_time",
        test,
    }
}

pub const REMOVALS: &[Removal] = &[
    in_time(
        "a round does not close before what arrived in time is done",
        "aggregator/src/round/aggregator.rs",
        &[("if self.arrivals.any_by(deadline_ms) {", "if false {")],
        "a_submission_that_arrived_in_time_is_not_late_however_long_it_takes",
    ),
    in_time(
        "what arrives late waits for what arrived in time",
        "aggregator/src/serve/recorder.rs",
        &[(
            "Some(deadline_ms) => !arrivals.any_by(deadline_ms),",
            "Some(_) => true,",
        )],
        "what_arrives_late_waits_for_what_arrived_in_time",
    ),
    in_time(
        "a submission of an earlier round costs next to nothing",
        "aggregator/src/round/recording/submission.rs",
        &[(
            "Err(reason) if !is_recorded(&reason) => return Err(reason.into()),\n            // What",
            "Err(_) if false => unreachable!(),\n            // What",
        )],
        "a_submission_of_an_earlier_round_is_turned_away_before_its_signature_is_verified",
    ),
    in_time(
        "a node's requests are done one after the other",
        "aggregator/src/serve/submitting.rs",
        &[(
            "        let _turn = self.turns.take(signed.statement.claim.terms.node).await;\n",
            "",
        )],
        "a_submission_that_comes_several_times_at_once_is_decided_once",
    ),
    Removal {
        check: "strangers cannot fill the metrics with names of methods",
        file: "aggregator/src/observe/answers.rs",
        replacements: &[("None => OTHER.into(),", "None => path.into(),")],
        package: "zk0-aggregator",
        target: "connections",
        test: "requests_to_methods_that_do_not_exist_are_counted_together",
    },
];
