//! The most that a rule about a time or a size can say. Without such bounds one vote could stop a network for ever: for example, no
//! proposal would end whose vote lasts a thousand years.

use crate::rules::network_rules::Rules;

const DAY_MS: u64 = 24 * 60 * 60 * 1000;

/// The longest part of a round: thirty days, in milliseconds.
pub const MAX_ROUND_WINDOW_MS: u64 = 30 * DAY_MS;

/// The longest vote, time lock and time for disputes: a leap year, in milliseconds.
pub const MAX_GOVERNANCE_WINDOW_MS: u64 = 366 * DAY_MS;

/// The largest file of weights: 64 GiB, an expert of 34 billion weights.
pub const MAX_UPDATE_BYTES: u64 = 64 << 30;

/// The largest proof: 64 MiB, fifty times what a compressed SP1 proof has. A proof is in memory as a whole.
pub const MAX_PROOF_BYTES: u64 = 64 << 20;

/// The most credits for one contribution. Credits of a million such contributions still fit 64 bits.
pub const MAX_CREDITS: u64 = 1 << 40;

/// Checks that no rule is above its bound. The error names the rule, its value and the bound.
pub(super) fn check(rules: &Rules) -> Result<(), String> {
    let Rules {
        credits,
        governance,
        ..
    } = rules;
    let round = MAX_ROUND_WINDOW_MS;
    let decision = MAX_GOVERNANCE_WINDOW_MS;
    let bounds = [
        ("commit_window_ms", rules.commit_window_ms, round),
        ("submit_window_ms", rules.submit_window_ms, round),
        ("randomness_window_ms", rules.randomness_window_ms, round),
        ("max_update_bytes", rules.max_update_bytes, MAX_UPDATE_BYTES),
        ("max_proof_bytes", rules.max_proof_bytes, MAX_PROOF_BYTES),
        (
            "credits.max_per_contribution",
            credits.max_per_contribution,
            MAX_CREDITS,
        ),
        (
            "credits.dispute_window_ms",
            credits.dispute_window_ms,
            decision,
        ),
        ("governance.voting_ms", governance.voting_ms, decision),
        ("governance.time_lock_ms", governance.time_lock_ms, decision),
    ];
    match bounds.iter().find(|(_, value, most)| value > most) {
        Some((rule, value, most)) => {
            Err(format!("rule {rule} is {value}; it can be at most {most}"))
        }
        None => Ok(()),
    }
}
