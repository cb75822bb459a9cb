//! Checks of the node: it believes nothing that an aggregator says of a round's randomness, does not train in vain, and contributes
//! to a round once.

use crate::Removal;

pub const REMOVALS: &[Removal] = &[
    Removal {
        check: "a node verifies the randomness itself",
        file: "node/src/challenge.rs",
        replacements: &[(
            "let verified = drawn.drawing.verify(&context);",
            "let verified = drawn.drawing.verify(&context).or(Ok(()));",
        )],
        package: "zk0-node",
        target: "lying_aggregator",
        test: "randomness_that_somebody_chose_is_no_randomness",
    },
    Removal {
        check: "a node sees the checkpoint that ends with the closing",
        file: "node/src/challenge.rs",
        replacements: &[("if checkpoint.size != receipt.index + 1 {", "if false {")],
        package: "zk0-node",
        target: "lying_aggregator",
        test: "other_entries_are_not_taken_for_the_closing_or_the_randomness",
    },
    Removal {
        check: "a node's number of samples is within the bounds of the rules",
        file: "node/src/participant.rs",
        replacements: &[(
            "match (least..=allowed).contains(&asked) && u64::from(asked) <= held {",
            "match u64::from(asked) <= held {",
        )],
        package: "zk0",
        target: "nodes",
        test: "a_number_of_samples_that_does_not_fit_ends_the_node_before_it_trains",
    },
    Removal {
        check: "a node has as many samples as it asks for",
        file: "node/src/participant.rs",
        replacements: &[(" && u64::from(asked) <= held {", " {")],
        package: "zk0",
        target: "nodes",
        test: "a_number_of_samples_that_does_not_fit_ends_the_node_before_it_trains",
    },
    Removal {
        check: "what is decided is decided once",
        file: "node/src/turn.rs",
        replacements: &[("Decided::read(self.state, &part)?", "None::<Decided>")],
        package: "zk0",
        target: "killed",
        test: "a_node_that_was_killed_after_its_decision_waits_for_the_close",
    },
];
