//! The moments of FedAdam ([`crate::rules::closing::server_moments`]): an entry names them just before the round closes. The
//! ledger shows only whether a round needs them. Auditors recompute them from blobs.

use crate::entries::entry::{MomentsComputed, RoundClosed};
use crate::rules::closing::server_moments::ServerMoments;
use crate::rules::network_rules::Strategy;
use crate::rules::state::{Round, State};
use crate::rules::violation::RuleViolation;

impl State {
    pub(super) fn check_moments(
        &self,
        computed: &MomentsComputed,
        time_ms: u64,
    ) -> Result<(), RuleViolation> {
        let round = self.open_round(computed.round)?;
        self.check_may_close(round, time_ms)?;
        if let Some(before) = &round.moments {
            let done = format!("{before}, and the ledger names them already");
            return Err(wrong(round, &computed.moments.to_string(), &done));
        }
        if self.by_fed_adam() && !self.contributors().is_empty() {
            Ok(())
        } else {
            Err(wrong(
                round,
                &computed.moments.to_string(),
                "none, since nobody contributed, or the strategy is not fed-adam",
            ))
        }
    }

    pub(super) fn compute_moments(&mut self, computed: &MomentsComputed) {
        if let Some(round) = &mut self.round {
            round.moments = Some(computed.moments);
        }
    }

    /// Checks that a round by FedAdam has moments if its result is taken.
    pub(super) fn check_closed_moments(
        &self,
        round: &Round,
        closed: &RoundClosed,
    ) -> Result<(), RuleViolation> {
        match (&round.moments, self.by_fed_adam() && closed.is_taken()) {
            (Some(_), true) | (None, false) => Ok(()),
            (None, true) => Err(wrong(
                round,
                "none",
                "those of its strategy, fed-adam, in an entry before the closing",
            )),
            (Some(moments), false) => Err(wrong(
                round,
                &moments.to_string(),
                "none, since the result was not taken",
            )),
        }
    }

    pub(super) fn keep_moments(&mut self, round: &Round) {
        if !self.by_fed_adam() {
            self.moments = None;
        }
        if let Some(blob) = round.moments {
            let steps = ServerMoments::steps(self.moments.as_ref()).saturating_add(1);
            self.moments = Some(ServerMoments { blob, steps });
        }
    }

    fn by_fed_adam(&self) -> bool {
        matches!(self.rules.strategy, Strategy::FedAdam { .. })
    }
}

fn wrong(round: &Round, found: &str, expected: &str) -> RuleViolation {
    RuleViolation::RoundField {
        round: round.number(),
        field: "moments",
        found: found.into(),
        expected: expected.into(),
    }
}
