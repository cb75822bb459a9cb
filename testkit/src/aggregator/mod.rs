//! An aggregator on loopback, a manual clock, and nodes that sign anything.

mod at_once;
mod folders;
mod genesis;
mod manual_clock;
mod network;
mod node;
mod open_round;
pub mod operator;
pub mod real_proof;
mod requests;
pub mod samples;
mod weights;
pub mod witnesses;

pub use self::at_once::{run_job, AtOnce};
pub use self::folders::{copy_of, files};
pub use self::genesis::{
    found, founding, genesis, log_key, write_policy, COMMIT_MS, GOVERNOR, MAX_PROOF_BYTES,
    MAX_UPDATE_BYTES, POLICY, START_MS, SUBMIT_MS, VOTING_MS,
};
pub use self::manual_clock::ManualClock;
pub use self::network::{Network, LONG_BYTES};
pub use self::node::{list, with_leaves, SigningNode, EVALUATION_FRAMES};
pub use self::open_round::{both_committed, committed, open_round, open_round_of};
pub use self::real_proof::REAL;
pub use self::requests::{reason, refused};
pub use self::weights::{digest, weights};
