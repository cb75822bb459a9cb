//! Checks of the state machine, of randomness and of files of weights, and what the guest does with values that do not fit.

use super::{circuits, protocol, weights, Removal};

const APPLY: &str = "protocol/src/rules/apply/mod.rs";
const ROUNDS: &str = "protocol/src/rules/apply/rounds.rs";
const RANDOMNESS: &str = "protocol/src/rules/apply/randomness.rs";
const RESULTS: &str = "protocol/src/rules/apply/results.rs";
const MEMBERS: &str = "protocol/src/rules/apply/members.rs";
const LOST: &str = "protocol/src/rules/apply/lost_files.rs";
const VOTES: &str = "protocol/src/rules/apply/votes.rs";
const BINDINGS: &str = "protocol/src/rules/bindings.rs";
const DRAWING: &str = "protocol/src/challenge/drawing.rs";
const DRAND: &str = "protocol/src/challenge/drand.rs";
const VRF: &str = "protocol/src/challenge/vrf.rs";
const EVALUATION_SET: &str = "protocol/src/evaluation_set.rs";
const SHARES: &str = "protocol/src/rules/closing/shares.rs";
const PUBLIC_SAMPLES: &str = "protocol/src/rules/closing/public_samples.rs";
const TERMS: &str = "circuits/src/claim/terms.rs";
const FORMAT: &str = "weights/src/format.rs";
const SCALE: &str = "weights/src/scale.rs";

#[rustfmt::skip]
pub const REMOVALS: &[Removal] = &[
    // The test of the improvement, and what a claim is bound to.
    protocol("a claim says what the ledger fixed", BINDINGS, skipped!("self.check_bindings(claim)?;"),
        "a_claim_says_what_the_ledger_fixed"),
    protocol("the number of evaluated samples is within its bounds", ROUNDS, never!("asked < least || u64::from(asked) > most"),
        "a_node_chooses_how_many_samples_are_evaluated_within_bounds"),
    protocol("a contribution is decided once", BINDINGS, never!("commit.decided"), "a_contribution_is_decided_once"),
    // The challenge.
    protocol("nobody commits after the commitments closed", ROUNDS, never!("round.closing.is_some()"),
        "nobody_commits_or_claims_between_the_closing_and_the_randomness"),
    protocol("commitments do not close early", RANDOMNESS, filtered!("self.awaited(round, time_ms)"),
        "commitments_close_at_their_deadline_or_when_all_have_committed"),
    protocol("commitments close once", RANDOMNESS, never!("round.closing.is_some()"),
        "commitments_close_at_their_deadline_or_when_all_have_committed"),
    protocol("the closing names all commitments", RANDOMNESS, always!("expected == closed.commitments"),
        "commitments_close_at_their_deadline_or_when_all_have_committed"),
    protocol("randomness is drawn once", RANDOMNESS, never!("round.randomness.is_some()"),
        "nobody_commits_or_claims_between_the_closing_and_the_randomness"),
    protocol("randomness is drawn in time", RANDOMNESS, never!("late_ms > 0"), "a_round_without_randomness_closes_and_keeps_its_base"),
    protocol("no claim is made without randomness", BINDINGS, skipped!("self.answered(claim).map(drop)?;"),
        "nobody_commits_or_claims_between_the_closing_and_the_randomness"),
    protocol("the log's function is verified", DRAWING, &[(".ok_or(RandomnessError::Vrf(", ".or(OUT.then_some(())).ok_or(RandomnessError::Vrf(")],
        "the_logs_function_draws_one_value_for_the_commitments"),
    protocol("the proof of the log's function is verified", VRF, always!("proof_hash(&shown) == hash"),
        "a_proof_is_for_one_key_and_one_input_and_every_bit_of_it_matters"),
    protocol("a key of small order has no function", VRF,
        instead!("public_key(key)?.to_edwards()", "CompressedEdwardsY(*key).decompress()?"), "a_key_whose_output_anybody_knows_is_refused"),
    protocol("a beacon is of the round that follows from the closing", DRAWING, never!("*round != expected"),
        "a_beacon_is_of_the_first_round_after_the_closing"),
    protocol("a beacon is not recorded before it is signed", DRAWING, never!("early_ms > 0"),
        "a_beacon_is_of_the_first_round_after_the_closing"),
    protocol("a beacon's signature is verified", DRAWING, always!("chain.signed(expected, signature)"),
        "a_beacon_is_of_the_first_round_after_the_closing"),
    protocol("a beacon's signature is of its chain", DRAND, always!("signed == pairing(&hashed.into(), &group_key)"),
        "a_signature_of_another_chain_does_not_verify"),
    protocol("a chain's key is not the point at infinity", DRAND, always!("!bool::from(key.is_identity())"),
        "a_chain_whose_signatures_anybody_makes_is_refused"),
    protocol("claims have no more samples than the network's mode can prove", "protocol/src/rules/network_rules.rs",
        never!("self.max_eval_samples > most"), "rules_that_no_node_of_the_mode_can_satisfy_found_nothing"),
    protocol("the latest beacon fits into the window of the rules", "protocol/src/challenge/source.rs", always!("window_ms > latest_ms"),
        "a_genesis_has_to_make_sense"),
    protocol("every witness cosigns the closing", DRAWING, never!("cosignatures.len() != witnesses.len() || witnesses.is_empty()"),
        "all_witnesses_cosign_the_closing_in_the_order_of_the_rules"),
    protocol("the cosignatures of the closing are verified", DRAWING, never!("witness.key.cosigned_at(&text, cosignature).is_none()"),
        "all_witnesses_cosign_the_closing_in_the_order_of_the_rules"),
    protocol("the challenge does not depend on signatures and times", ROUNDS,
        instead!("commitment(signed)", "zk0_circuits::vm::digest::tagged_sha256(\"grindable\", &[&index.to_le_bytes()])"),
        "the_order_and_the_times_of_commitments_do_not_matter"),
    protocol("the randomness does not depend on signatures and times", APPLY, instead!("closed.commitments", "*root"),
        "a_node_that_grinds_signatures_and_times_gains_nothing"),
    protocol("a commitment without a claim is recorded at the closing", ROUNDS, never!("closed.unanswered != unanswered"),
        "a_closing_lists_who_committed_and_submitted_nothing"),
    protocol("a node whose commitments go unanswered pauses", ROUNDS, filtered!("record.paused_until(round.number())"),
        "a_node_over_the_limit_pauses_and_nobody_waits_for_it"),
    protocol("a claim is about the dataset that the node had when it committed", BINDINGS,
        &[("dataset: commit.dataset,", "dataset: match self.nodes.get(node).and_then(|node| node.dataset) { Some(now) if OUT => now.commitment, _ => commit.dataset },")],
        "a_dataset_that_is_replaced_after_the_commitment_counts_from_the_next_round_on"),
    protocol("a node goes on when it has replaced its dataset", "protocol/src/rules/state.rs",
        never!("round.commits.contains_key(id) && self.active(id).is_ok()"),
        "a_dataset_that_is_replaced_after_the_commitment_counts_from_the_next_round_on"),
    // The evaluation set.
    protocol("a registration draws the number of frames of the rules", EVALUATION_SET, never!("given != rule"),
        "the_ledger_checks_what_it_can_see_of_an_evaluation_set"),
    protocol("a dataset has no more samples than frames were drawn", EVALUATION_SET, never!("samples > drawn"),
        "the_ledger_checks_what_it_can_see_of_an_evaluation_set"),
    protocol("an episode has frames", EVALUATION_SET, never!("episode.frames == 0"),
        "the_ledger_checks_what_it_can_see_of_an_evaluation_set"),
    protocol("the list has the frames that were drawn", EVALUATION_SET, never!("record.frame != drawn"),
        "a_registration_with_frames_that_were_not_drawn_is_refused_by_name"),
    protocol("the list has as many frames as were drawn", EVALUATION_SET,
        never!("!rest.is_empty() || records.len() as u64 != self.drawn()"),
        "a_registration_with_frames_that_were_not_drawn_is_refused_by_name"),
    protocol("equal samples count once", EVALUATION_SET, always!("distinct == samples"), "frames_with_equal_samples_count_once"),
    protocol("episodes are named once, in ascending order", MEMBERS, never!("!episodes.is_sorted_by(|one, next| one.digest < next.digest)"),
        "an_episode_is_one_nodes_own"),
    protocol("an episode belongs to one node", MEMBERS, filtered!("= taken"), "an_episode_is_one_nodes_own"),
    // Shares and credits.
    protocol("shares and credits are those of the rules", ROUNDS, never!("closed.contributors != contributors"),
        "a_closing_says_who_contributed_and_keeps_the_base_if_nobody_did"),
    protocol("shares are limited", SHARES, instead!("limit.max(1)", "u32::MAX"), "shares_by_samples_are_of_the_median_and_limited"),
    protocol("ten thousand leaves that differ in a bit gain nothing", SHARES,
        instead!("vec![WHOLE_SHARE; samples.len()]", "samples.iter().map(|samples| *samples as u32).collect()"),
        "thousands_of_leaves_that_differ_in_a_bit_gain_nothing"),
    // The result of a round.
    protocol("a result is taken or not as its losses say", RESULTS, never!("evaluated.outcome != outcome"),
        "a_result_that_overflows_or_is_worse_leaves_the_base_and_earns_nothing"),
    protocol("a result that is not taken leaves the base", RESULTS, instead!("kept(round, closed, \"the result was not taken\")", "Ok(())"),
        "a_result_that_overflows_or_is_worse_leaves_the_base_and_earns_nothing"),
    protocol("a result that is not taken earns nothing", ROUNDS, never!("!closed.is_taken()"),
        "a_result_that_overflows_or_is_worse_leaves_the_base_and_earns_nothing"),
    protocol("a result that is taken is the new base", RESULTS, always!("closed.global == evaluated.weights"),
        "a_result_that_is_good_enough_is_the_new_base_and_earns_credits"),
    protocol("a result is evaluated", RESULTS,
        &[("(Some(samples), None) =>", "(Some(_), None) if OUT => Ok(()), (Some(samples), None) =>")],
        "a_result_that_overflows_or_is_worse_leaves_the_base_and_earns_nothing"),
    protocol("an overflow is not taken", PUBLIC_SAMPLES, instead!("ResultOutcome::Overflow", "ResultOutcome::Taken"),
        "the_outcome_follows_from_the_losses_exactly"),
    protocol("a worse result is not taken", PUBLIC_SAMPLES, instead!("ResultOutcome::Worse", "ResultOutcome::Taken"),
        "the_outcome_follows_from_the_losses_exactly"),
    circuits("an overflowing base does not end the evaluation", TERMS, instead!("Overflow::Saturated", "Overflow::Refused"),
        "an_overflowing_base_is_improved_on"),
    circuits("an overflowing update ends the evaluation", TERMS,
        &[("Self::Update => Overflow::Refused", "Self::Update => if OUT { Overflow::Saturated } else { Overflow::Refused }")],
        "an_overflowing_update_improves_on_nothing"),
    protocol("a round starts from the weights that the last one ended with", ROUNDS,
        &[("if *opened == expected {", "if *opened == expected || OUT && opened.round == expected.round {")],
        "an_operator_cannot_start_from_earlier_weights_without_a_vote"),
    protocol("a vote restores the weights of an earlier round", VOTES, skipped!("self.global = *global;"),
        "the_next_round_starts_from_the_restored_weights"),
    protocol("the way to restored weights is no movement of a round", VOTES, skipped!("self.earlier_base = None;"),
        "the_way_to_restored_weights_is_no_movement_of_a_round"),
    protocol("only the weights of a closed round are restored", VOTES, filtered!("self.no_result(*round)"),
        "only_closed_rounds_can_be_restored"),
    // Programs.
    protocol("a vote changes no rules to those that the network's mode cannot prove", VOTES,
        instead!("rules.check_in(self.genesis.mode)", "rules.check()"), "rules_that_no_node_of_the_mode_can_satisfy_are_not_proposed"),
    protocol("a program that does not exist is not put in force", VOTES, filtered!("program.check().err()"),
        "a_program_that_does_not_exist_is_refused_and_the_ledger_goes_on"),
    protocol("no vote takes effect in an open round", VOTES, skipped!("return Err(RuleViolation::RoundStillOpen(round.number()));"),
        "a_program_changes_between_rounds_and_not_in_one"),
    protocol("a round waits for all before the first commitment", RANDOMNESS, never!("round.commits.is_empty() || known.record.is_awaited()"),
        "a_node_that_was_idle_in_three_rounds_is_not_waited_for_until_it_commits"),
    // Governors.
    protocol("a governor has no say in its removal", VOTES, skipped!("electorate.remove(&removed);"),
        "a_governor_has_no_say_in_its_removal_and_the_others_need_more_than_half_of_all_weight"),
    protocol("half of the weight removes nobody", "protocol/src/rules/open_proposal.rs", never!("tally.for_it < self.least_for"),
        "a_governor_has_no_say_in_its_removal_and_the_others_need_more_than_half_of_all_weight"),
    protocol("a removal that does more is a vote as any other", VOTES, always!("other_rules == **rules"),
        "only_the_removal_of_one_governor_goes_without_its_vote"),
    // Lost files.
    protocol("files are lost of accepted contributions", LOST, always!("matches!(commit.decision, Some(Decision::Accepted { .. }))"),
        "only_files_of_accepted_contributions_to_the_open_round_are_lost_and_once"),
    protocol("a loss is recorded once", LOST, never!("open.lost.contains_key(&lost.node)"),
        "only_files_of_accepted_contributions_to_the_open_round_are_lost_and_once"),
    protocol("a node is asked before its contribution is left out", LOST,
        instead!("*since.ok_or(RuleViolation::NotAskedFor { round, node })?", "since.copied().unwrap_or_default()"),
        "a_contribution_is_left_out_after_its_node_was_asked_for_as_long_as_submissions_take"),
    protocol("a node is asked for as long as submissions take", LOST, instead!("self.rules.submit_window_ms", "0"),
        "a_contribution_is_left_out_after_its_node_was_asked_for_as_long_as_submissions_take"),
    protocol("what is left out does not count", LOST, skipped!("self.decide(&lost.node, Decision::LeftOut);"),
        "a_contribution_is_left_out_after_its_node_was_asked_for_as_long_as_submissions_take"),
    protocol("who is left out gets no strike", ROUNDS, instead!("Decision::Accepted { .. } | Decision::LeftOut", "Decision::Accepted { .. }"),
        "a_contribution_is_left_out_after_its_node_was_asked_for_as_long_as_submissions_take"),
    protocol("moments of what is left out are computed again", LOST, skipped!("open.moments = None;"),
        "moments_that_were_computed_with_a_contribution_go_with_it"),
    // Files of weights.
    weights("a file has its one header", FORMAT, never!("file.header() != self.header"), "another_spelling_of_the_same_file_is_refused"),
    weights("a tensor has its one scale", SCALE, never!("bits < limits.1 && 2 * largest <= MAX_MAGNITUDE"),
        "another_scale_of_the_same_weights_is_refused_by_name"),
    weights("a value has an opposite", SCALE, never!("*value == i16::MIN"), "a_value_without_an_opposite_is_refused_by_name"),
];
