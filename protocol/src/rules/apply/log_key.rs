//! The operator gives the log another key.

use crate::quote::short;
use crate::rules::state::State;
use crate::rules::violation::RuleViolation;
use crate::tlog::key_rotation::{LogKeyRotation, LogKeyTakeover};

impl State {
    /// Only the key that founded the network gives the log another one, at this place of the log alone. A key that somebody has or had here
    /// would sign two kinds of things, and a former key of the log may be stolen.
    pub(super) fn check_log_key(
        &self,
        rotation: &LogKeyRotation,
        takeover: &LogKeyTakeover,
    ) -> Result<(), RuleViolation> {
        self.check_network(&rotation.network)?;
        if rotation.operator.0 != self.genesis.log_key {
            return Err(RuleViolation::NotOperator(rotation.operator));
        }
        if takeover.rotation != *rotation {
            return Err(RuleViolation::OtherLogTakeover(rotation.with));
        }
        if rotation.log != self.genesis.origin() {
            return Err(RuleViolation::OtherLog {
                found: short(&rotation.log),
                expected: self.genesis.origin().into(),
            });
        }
        if rotation.entry != self.entries {
            return Err(RuleViolation::OtherLogKeyEntry {
                entry: rotation.entry,
                next: self.entries,
            });
        }
        let with = rotation.with;
        if self.log_keys.have(&with.0) || self.is_used(&with) || self.governs(&with) {
            return Err(RuleViolation::UsedKey(with));
        }
        Ok(())
    }
}
