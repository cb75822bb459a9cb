//! The most that a rule about a time or a size can say. Without such bounds one vote could stop a network for ever: for example, no
//! proposal would end whose vote lasts a thousand years.

const DAY_MS: u64 = 24 * 60 * 60 * 1000;

/// The longest part of a round: thirty days, in milliseconds.
pub const MAX_ROUND_WINDOW_MS: u64 = 30 * DAY_MS;

/// The longest vote, time lock and time for disputes: a leap year, in milliseconds.
pub const MAX_GOVERNANCE_WINDOW_MS: u64 = 366 * DAY_MS;

/// The largest file of weights: 64 GiB, an expert of 34 billion weights.
pub const MAX_UPDATE_BYTES: u64 = 64 << 30;

/// The largest proof: 64 MiB, fifty times what a compressed SP1 proof has. A proof is in memory as a whole.
pub const MAX_PROOF_BYTES: u64 = 64 << 20;

/// Most nodes that may commit in one round. The entry that closes the round names each of them, in 44 bytes. So no rule can ask for more
/// nodes to be present.
pub const MAX_COMMITS: usize = 1300;

/// The longest pause of a node that leaves its commitments without claims, in rounds. A pause that has begun outlasts a vote that shortens the rule.
pub const MAX_PAUSE_ROUNDS: u64 = 1000;

/// The most credits for one contribution. The sum over a million such contributions still fits 64 bits.
pub const MAX_CREDITS: u64 = 1 << 40;
