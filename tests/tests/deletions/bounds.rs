//! Checks of what rules may say.

use crate::ledger_rules::rule;
use crate::Removal;

pub const REMOVALS: &[Removal] = &[rule(
    "rules about times and sizes have upper bounds",
    "protocol/src/rules/network_rules.rs",
    &[("        self.check_upper_bounds()?;\n", "")],
    "rules_that_would_stop_a_network_for_ever_found_nothing",
)];
