//! The randomness of the challenges. It is unknown before a round's commitments have closed, as far as its source allows.
//!
//! - [`source`]: the sources that rules can name;
//! - [`vrf`]: a verifiable random function of the log's key;
//! - [`drand`]: a public beacon;
//! - [`closing`]: a round's closed commitments;
//! - [`drawing`]: the randomness on the ledger, and its verification;
//! - [`unanswered`]: how often a node may commit without a claim that counts.

pub mod closing;
pub mod drand;
pub mod drawing;
pub mod source;
pub mod unanswered;
pub mod vrf;
