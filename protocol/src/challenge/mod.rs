//! Where the randomness of the challenges comes from. Nobody can know it before the commitments of a round have closed, as far as its
//! source allows.
//!
//! - [`source`]: the sources that a network's rules can name;
//! - [`vrf`]: a verifiable random function of the log's key;
//! - [`drand`]: a public beacon;
//! - [`closing`]: how the commitments of a round closed, from which the randomness follows;
//! - [`drawing`]: what the ledger records of the randomness, and how anybody verifies it;
//! - [`unanswered`]: how often a node may commit without a claim that counts.

pub mod closing;
pub mod drand;
pub mod drawing;
pub mod source;
pub mod unanswered;
pub mod vrf;
