//! Checks of the node: it believes nothing that an aggregator says of a round's randomness.

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
];
