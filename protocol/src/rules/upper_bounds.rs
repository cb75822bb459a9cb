//! The upper bounds of times and sizes in rules. Without them one vote could stop a network for ever, with a vote of a thousand
//! years.

const DAY_MS: u64 = 24 * 60 * 60 * 1000;

/// The longest part of a round: thirty days, in milliseconds.
pub const MAX_ROUND_WINDOW_MS: u64 = 30 * DAY_MS;

/// The longest vote, time lock and time for disputes: a leap year, in milliseconds.
pub const MAX_GOVERNANCE_WINDOW_MS: u64 = 366 * DAY_MS;

/// The largest file of weights: 64 GiB, an expert of 34 billion weights.
pub const MAX_UPDATE_BYTES: u64 = 64 << 30;

/// The largest proof: 64 MiB, fifty times a compressed SP1 proof. Proofs are in memory as a whole.
pub const MAX_PROOF_BYTES: u64 = 64 << 20;

/// Most nodes that commit in one round, or must be present: the entry that closes it names each in 44 bytes.
pub const MAX_COMMITS: usize = 1300;

/// The longest pause after commitments without claims, in rounds. A vote does not shorten a pause that has begun.
pub const MAX_PAUSE_ROUNDS: u64 = 1000;

/// The most credits for one contribution. A million of them still sum to 64 bits.
pub const MAX_CREDITS: u64 = 1 << 40;
