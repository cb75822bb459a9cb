//! Checks of an aggregator whose witnesses do not cosign, or are others than before.

use super::{aggregator, Removal};

const CLIENT: &str = "aggregator/src/publish/witness_client.rs";
const OUTAGE: &str = "aggregator/src/round/outage.rs";

#[rustfmt::skip]
pub const REMOVALS: &[Removal] = &[
    aggregator("a cosignature is kept for its checkpoint", CLIENT, filtered!("signed.filter(|signed| signed.checkpoint == checkpoint)"),
        "a_witness_that_has_cosigned_a_checkpoint_is_not_asked_for_it_again"),
    aggregator("a witness that refuses is asked after growing waits", CLIENT, always!("Instant::now() >= outage.next"),
        "a_witness_that_refuses_is_asked_less_and_less"),
    aggregator("a witness chooses when it is asked again", CLIENT, instead!("why.told()", "Duration::ZERO"),
        "a_witness_is_asked_no_sooner_than_it_wants_to_be"),
    aggregator("a witness does not choose a time that never comes", CLIENT, instead!("(*after).min(MOST_TOLD)", "*after"),
        "a_witness_is_asked_no_sooner_than_it_wants_to_be"),
    aggregator("a quorum is enough to publish the closing of commitments", "aggregator/src/serve/publishing.rs",
        &[("if size > published {", "if size > published && !(OUT && draws.is_some()) {")],
        "all_witnesses_draw_the_randomness_and_one_of_them_may_be_late"),
    aggregator("a vote counts without the witnesses", "aggregator/src/serve/federation_service.rs",
        &[("if governs => true,", "if governs && !OUT => true,")], "a_policy_that_is_not_met_is_voted_away"),
    aggregator("a round ends where a vote waits for its end", OUTAGE,
        instead!("self.state().due(now_ms).is_none()", "true"), "a_round_ends_where_a_vote_for_other_witnesses_waits_for_its_end"),
    aggregator("new witnesses are asked before their vote is settled", OUTAGE,
        never!("is_new && !asked && *outcome == Outcome::Executed"), "a_policy_that_is_not_met_is_voted_away"),
    aggregator("a policy is new if it changed since the cosigned checkpoint", OUTAGE, always!("before.text() != policy.text()"),
        "only_a_vote_since_the_last_cosigned_checkpoint_makes_a_policy_new"),
    aggregator("a policy of the operator is not new", OUTAGE,
        &[("Some((size, false)) if is_ruled", "Some((size, false)) if OUT || is_ruled")],
        "only_a_vote_since_the_last_cosigned_checkpoint_makes_a_policy_new"),
    aggregator("a damaged cosigned checkpoint is told from another policy's", OUTAGE,
        &[("Err(error) => return Err(damaged(error))", "Err(_) if OUT => false, Err(error) => return Err(damaged(error))")],
        "a_damaged_cosigned_checkpoint_makes_no_policy_new"),
    aggregator("the ledger goes on from its cosigned checkpoint", OUTAGE, skipped!("self.ledger.continues(&checkpoint)?;"),
        "a_damaged_cosigned_checkpoint_makes_no_policy_new"),
];
