//! Checks of what rules and refusals may state, of the number of nodes that rounds wait for, of nodes that leave, and of votes.

use super::{protocol, Removal};

const ROUNDS: &str = "protocol/src/rules/apply/rounds.rs";
const MEMBERS: &str = "protocol/src/rules/apply/members.rs";
const NETWORK_RULES: &str = "protocol/src/rules/network_rules.rs";

#[rustfmt::skip]
pub const REMOVALS: &[Removal] = &[
    protocol("a refusal for lateness states what came late", "protocol/src/rules/bindings.rs", always!("what == late"),
        "a_late_claim_is_refused_as_such"),
    protocol("rules about times and sizes have upper bounds", NETWORK_RULES, skipped!("self.check_upper_bounds()?;"),
        "rules_that_would_stop_a_network_for_ever_found_nothing"),
    protocol("no round opens with fewer nodes than have to be present", ROUNDS, skipped!("self.check_enough_nodes()?;"),
        "a_round_does_not_open_with_fewer_nodes_than_have_to_be_present"),
    protocol("the rules ask for no more nodes than can commit", NETWORK_RULES, never!("!(1..=most).contains(min_nodes)"),
        "no_rule_asks_for_more_than_there_can_be"),
    protocol("the rules of SCAFFOLD have bounds", "protocol/src/rules/closing/strategy.rs", skipped!("within(\"steps\", steps, 1, MAX_LOCAL_STEPS)?;"),
        "scaffold_by_which_nobody_could_train_founds_nothing"),
    protocol("a node signs that it leaves", "protocol/src/entries/authentic.rs",
        &[("Body::NodeLeft(signed) =>", "Body::NodeLeft(_) if OUT => {} Body::NodeLeft(signed) =>")],
        "a_node_leaves_by_its_own_wish_of_this_time"),
    protocol("a node leaves this network", MEMBERS, skipped!("self.check_network(&leaving.network)?;"),
        "a_node_leaves_by_its_own_wish_of_this_time"),
    protocol("a node leaves once", MEMBERS, skipped!("self.active(&leaving.node)?;"),
        "a_node_that_has_left_takes_part_again_once_it_is_enrolled_again"),
    protocol("an old leaving does not count again", MEMBERS, never!("leaving.round != self.next_round"),
        "a_node_leaves_by_its_own_wish_of_this_time"),
    protocol("a node that has committed leaves when the round is over", MEMBERS, never!("round.commits.contains_key(&leaving.node)"),
        "a_node_leaves_by_its_own_wish_of_this_time"),
    protocol("only who has left is enrolled again", MEMBERS, never!("self.is_used(&enrolled.node) && !left"),
        "a_node_that_has_left_takes_part_again_once_it_is_enrolled_again"),
    protocol("nobody escapes a dispute by leaving", "protocol/src/rules/apply/disputes.rs",
        instead!("node.standing != Standing::Revoked", "node.standing == Standing::Active"),
        "nobody_escapes_a_judgement_by_leaving"),
    protocol("a vote is for the proposal that its voter has seen", "protocol/src/rules/apply/votes.rs", never!("open.digest != vote.of"),
        "a_vote_is_for_the_proposal_that_its_voter_has_seen"),
];
