//! Traces: what a stranger's header, or a collector that is down, could do.

use crate::Removal;

const fn traced(
    check: &'static str,
    file: &'static str,
    replacements: &'static [(&'static str, &'static str)],
    test: &'static str,
) -> Removal {
    Removal {
        check,
        file,
        replacements,
        package: "zk0",
        target: "traces",
        test,
    }
}

pub const REMOVALS: &[Removal] = &[
    traced(
        "whoever sends a request does not say whether it is traced",
        "traces/src/export.rs",
        &[(
            "            .with_sampler(Sampler::AlwaysOn)\n",
            "            .with_sampler(Sampler::ParentBased(Box::new(Sampler::AlwaysOn)))\n",
        )],
        "a_header_neither_hides_a_request_nor_adds_to_its_span",
    ),
    Removal {
        check: "a header that names a trace has its length",
        file: "traces/src/carried.rs",
        replacements: &[("(text.len() == LENGTH).then_some", "true.then_some")],
        package: "zk0-traces",
        target: "carried",
        test: "a_header_in_another_form_is_not_taken",
    },
    traced(
        "a collector that is down is logged once",
        "traces/src/export.rs",
        &[("Err(why) if !failed_before =>", "Err(why) =>")],
        "a_collector_that_is_down_is_logged_once_and_gets_traces_when_it_is_there",
    ),
    traced(
        "a collector that does not answer is given up",
        "traces/src/export.rs",
        &[(
            "match timeout(PATIENCE, otlp",
            "match timeout(100 * PATIENCE, otlp",
        )],
        "a_collector_that_never_answers_holds_nobody_up",
    ),
    traced(
        "the end waits for no collector",
        "traces/src/export.rs",
        &[(
            "const ENDING: Duration = Duration::from_secs(2);",
            "const ENDING: Duration = Duration::from_secs(200);",
        )],
        "a_collector_that_never_answers_holds_nobody_up",
    ),
];
