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
        check: "control variates follow from the node's own contribution",
        file: "node/src/client.rs",
        replacements: &[(
            "match of == (*self.network(), round, self.id()) && signed.verify().is_ok() {",
            "match of.1 == round || signed.verify().is_ok() {",
        )],
        package: "zk0-node",
        target: "lying_aggregator",
        test: "the_contribution_of_somebody_else_is_not_the_node_s_own",
    },
    Removal {
        check: "a round by SCAFFOLD is trained as the rules say",
        file: "node/src/turn.rs",
        replacements: &[("            training.check_beside_scaffold(round)?;\n", "")],
        package: "zk0",
        target: "against_drift",
        test: "options_that_would_change_the_steps_end_the_node",
    },
    Removal {
        check: "control variates begin again after restored weights",
        file: "node/src/turn/scaffold.rs",
        replacements: &[(" || closed.global != next_base {", " {")],
        package: "zk0",
        target: "against_drift",
        test: "control_variates_begin_again_after_restored_weights_and_with_other_rules",
    },
    Removal {
        check: "control variates begin again with other rules",
        file: "node/src/turn/scaffold.rs",
        replacements: &[(
            "if opened.rules.strategy != Strategy::Scaffold(*rule) || closed.global != next_base {",
            "if closed.global != next_base {",
        )],
        package: "zk0",
        target: "against_drift",
        test: "control_variates_begin_again_after_restored_weights_and_with_other_rules",
    },
    Removal {
        check: "control variates on disk are those that the node wrote",
        file: "node/src/turn/control_variates.rs",
        replacements: &[(
            "        let whole = whole.filter(|(bytes, hash)| Sha256::digest(bytes)[..] == hash[..]);\n",
            "",
        )],
        package: "zk0",
        target: "against_drift",
        test: "a_node_computes_its_control_variates_from_the_ledger",
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
    Removal {
        check: "a node submits the proof that it has made",
        file: "node/src/turn.rs",
        replacements: &[("Proven::read(self.state, &expected.terms)?", "None::<Proven>")],
        package: "zk0",
        target: "killed",
        test: "a_node_whose_answer_was_lost_submits_the_same_proof_again",
    },
    Removal {
        check: "a node whose claim is decided does not prove it again and again",
        file: "node/src/participant.rs",
        replacements: &[("if status.code() == Code::AlreadyExists =>", "if false =>")],
        package: "zk0",
        target: "killed",
        test: "a_node_whose_answer_was_lost_submits_the_same_proof_again",
    },
    Removal {
        check: "a file that fails is no reason to leave a commitment unanswered",
        file: "prover/src/program/guest_input.rs",
        replacements: &[("            Self::Sample(_)\n                | Self::Argument", "            Self::Argument")],
        package: "zk0-prover",
        target: "not_provable",
        test: "a_file_that_fails_says_nothing_about_the_claim",
    },
    Removal {
        check: "a node that comes too late goes on with the next round",
        file: "node/src/participant.rs",
        replacements: &[("&& node.commits_no_more(round).await? =>", "&& false =>")],
        package: "zk0",
        target: "cut_network",
        test: "a_node_that_is_cut_off_until_its_round_has_ended_takes_part_in_the_next",
    },
];
