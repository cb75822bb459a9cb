//! Checks of a node: of its secrets, of its count of arguments, and of its program.

use super::{node, Removal};

const SECRET: &str = "node/src/recording/secret.rs";
const REGISTERING: &str = "node/src/recording/registering.rs";

#[rustfmt::skip]
pub const REMOVALS: &[Removal] = &[
    node("a node begins no round whose program it lacks", "node/src/client/carried.rs", always!("carried.contains(&open.program)"),
        "a_node_waits_while_it_lacks_the_program_in_force"),
    node("a node that is told two programs pauses", "node/src/client/carried.rs", skipped!("lack.waits.shortly().await;"),
        "a_node_that_is_told_two_programs_asks_less_and_less_often"),
    node("a node that lacks the program does not start", "node/src/client/carried.rs", always!("carried.contains(&needed)"),
        "a_node_waits_while_it_lacks_the_program_in_force"),
    node("an argument is counted before it is made", "node/src/turn/prepared_claim.rs",
        skipped!("count(&state, &secret, &leaves, most_uses(&input.header().spec))?;"), "an_argument_is_counted_before_it_is_made"),
    node("a count is on disk", SECRET,
        &[("    secrets.keep(state)\n}", "    if OUT { return Ok(()); }\n    secrets.keep(state)\n}")],
        "a_node_with_a_limit_of_2_uses_refuses_the_third"),
    node("a sample that is worn out is opened no more", SECRET, never!("*opened >= most"), "a_node_with_a_limit_of_2_uses_refuses_the_third"),
    node("a node's secrets are for its owner alone", SECRET,
        instead!("atomic_file::replace_private(&path, &self.encode())", "atomic_file::replace(&path, &self.encode())"),
        "a_node_with_a_limit_of_2_uses_refuses_the_third"),
    node("a file of secrets has its checksum", SECRET, never!("tagged_sha256(CHECKSUM, &[all]).0 != *checksum"),
        "a_lost_or_damaged_file_stops_the_argument_and_stays_as_it_is"),
    node("a sample is not found under another secret", SECRET,
        instead!("self.derived(\"zk0/node-secret/sample-file/v1\", &frame.0)", "Digest(frame.0)"),
        "under_another_secret_each_sample_is_made_again"),
    node("a lost secret is not replaced", REGISTERING,
        &[("= self.registered(node)? {", "= self.registered(node)?.filter(|_| !OUT) {")],
        "a_node_whose_secret_is_lost_stops_and_says_how_to_register_again"),
    node("a secret is of one recording", REGISTERING, always!("secrets.is_unused(newest) && of_kept != Some(newest)"),
        "a_secret_is_of_one_recording_and_an_interrupted_node_keeps_it"),
    node("a worn secret is replaced", REGISTERING, &[("if done ||", "if done || OUT ||")],
        "a_worn_secret_is_replaced_and_begun_rounds_end_with_the_old_one"),
    node("a fresh secret is on disk before the ledger knows of it", REGISTERING, skipped!("secrets.keep(self.state)?;"),
        "a_worn_secret_is_replaced_and_begun_rounds_end_with_the_old_one"),
    node("a node ends what it has begun with the dataset that it had", REGISTERING,
        filtered!("unfinished::begun(self.state, node.network(), round)?"),
        "a_worn_secret_is_replaced_and_begun_rounds_end_with_the_old_one"),
];
