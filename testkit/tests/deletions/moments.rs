//! Checks of the moments that rounds by FedAdam end with.

use super::{protocol, Removal};

const MOMENTS: &str = "protocol/src/rules/apply/moments.rs";

#[rustfmt::skip]
pub const REMOVALS: &[Removal] = &[
    protocol("a round by FedAdam names its moments before it closes", "protocol/src/rules/apply/rounds.rs",
        skipped!("self.check_closed_moments(round, closed)?;"), "a_round_by_fed_adam_cannot_close_without_its_moments"),
    protocol("moments are named when the round may close", MOMENTS, skipped!("self.check_may_close(round, time_ms)?;"),
        "moments_are_named_once_and_only_when_the_round_may_close"),
    protocol("moments are named once", MOMENTS, &[("= &round.moments {", "= round.moments.as_ref().filter(|_| !OUT) {")],
        "moments_are_named_once_and_only_when_the_round_may_close"),
    protocol("other strategies have no moments", MOMENTS, always!("self.by_fed_adam() && !self.contributors().is_empty()"),
        "other_strategies_and_rounds_without_contributors_have_no_moments"),
    protocol("a result that is not taken leaves no moments", MOMENTS,
        &[("(Some(moments), false) =>", "(Some(_), false) if OUT => Ok(()), (Some(moments), false) =>")],
        "a_round_that_keeps_its_base_keeps_its_moments"),
    protocol("restored weights have no moments", "protocol/src/rules/apply/votes.rs", skipped!("self.moments = None;"),
        "restored_weights_have_no_moments"),
    protocol("another strategy keeps no moments", MOMENTS, skipped!("self.moments = None;"), "restored_weights_have_no_moments"),
];
