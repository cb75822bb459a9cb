//! Checks of what rules and refusals may say, of the number of nodes that rounds wait for, of nodes that leave, and of votes.

use crate::ledger_rules::rule;
use crate::Removal;

pub const REMOVALS: &[Removal] = &[
    rule(
        "a refusal for lateness says what came late",
        "protocol/src/rules/apply/rounds.rs",
        &[(
            "round == open && what == late",
            "round == open && what.len() < usize::MAX && late.len() < usize::MAX",
        )],
        "a_late_claim_is_refused_as_such",
    ),
    rule(
        "rules about times and sizes have upper bounds",
        "protocol/src/rules/network_rules.rs",
        &[("        self.check_upper_bounds()?;\n", "")],
        "rules_that_would_stop_a_network_for_ever_found_nothing",
    ),
    rule(
        "a dataset does not change under a commitment",
        "protocol/src/rules/apply/members.rs",
        &[(
            "Some(round) if round.commits.contains_key(&node) => Err(RuleViolation::DatasetInUse {",
            "Some(round) if round.number() == u64::MAX => Err(RuleViolation::DatasetInUse {",
        )],
        "datasets_do_not_change_under_a_commitment",
    ),
    rule(
        "no round opens with fewer nodes than have to be present",
        "protocol/src/rules/apply/rounds.rs",
        &[("        self.check_enough_nodes()?;\n", "")],
        "a_round_does_not_open_with_fewer_nodes_than_have_to_be_present",
    ),
    rule(
        "the rules ask for no more nodes than can commit",
        "protocol/src/rules/network_rules.rs",
        &[("if !(1..=most).contains(min_nodes) {", "if false {")],
        "no_rule_asks_for_more_than_there_can_be",
    ),
    rule(
        "the rules of SCAFFOLD have bounds",
        "protocol/src/rules/network_rules.rs",
        &[(
            "                within(\"steps\", steps, 1, MAX_LOCAL_STEPS)?;\n",
            "                let _ = (steps, MAX_LOCAL_STEPS);\n",
        )],
        "scaffold_by_which_nobody_could_train_founds_nothing",
    ),
    rule(
        "a node signs that it leaves",
        "protocol/src/entries/authentic.rs",
        &[(
            "            Body::NodeLeft(signed) => verify(signed, keys)?,\n",
            "            Body::NodeLeft(_) => {}\n",
        )],
        "a_node_leaves_by_its_own_wish_of_this_time",
    ),
    rule(
        "a node leaves this network",
        "protocol/src/rules/apply/members.rs",
        &[("        self.check_network(&leaving.network)?;\n", "")],
        "a_node_leaves_by_its_own_wish_of_this_time",
    ),
    rule(
        "a node leaves once",
        "protocol/src/rules/apply/members.rs",
        &[("        self.active(&leaving.node)?;\n", "")],
        "a_node_that_has_left_takes_part_again_once_it_is_enrolled_again",
    ),
    rule(
        "an old leaving does not count again",
        "protocol/src/rules/apply/members.rs",
        &[("if leaving.round != self.next_round {", "if false {")],
        "a_node_leaves_by_its_own_wish_of_this_time",
    ),
    rule(
        "a node that has committed leaves when the round is over",
        "protocol/src/rules/apply/members.rs",
        &[(
            "Some(round) if round.commits.contains_key(&leaving.node) => {",
            "Some(round) if false && round.commits.is_empty() => {",
        )],
        "a_node_leaves_by_its_own_wish_of_this_time",
    ),
    rule(
        "only who has left is enrolled again",
        "protocol/src/rules/apply/members.rs",
        &[(
            "match self.is_used(&enrolled.node) && !left {",
            "match false && !left {",
        )],
        "a_node_that_has_left_takes_part_again_once_it_is_enrolled_again",
    ),
    rule(
        "nobody escapes a dispute by leaving",
        "protocol/src/rules/apply/disputes.rs",
        &[(
            "if matches!(node.standing, Standing::Active | Standing::Left) {",
            "if matches!(node.standing, Standing::Active) {",
        )],
        "nobody_escapes_a_judgement_by_leaving",
    ),
    Removal {
        target: "voting",
        ..rule(
            "a vote is for the proposal that its voter has seen",
            "protocol/src/rules/apply/votes.rs",
            &[("if open.digest != vote.of {", "if false {")],
            "a_vote_is_for_the_proposal_that_its_voter_has_seen",
        )
    },
];
