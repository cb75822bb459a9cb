//! The rounds of a network, and the ledger's one writer.

pub mod accepted;
pub mod aggregator;
pub mod awaited_beacon;
pub mod clock;
pub mod closing;
pub mod dispute;
pub mod drawing;
pub mod founding;
pub mod intake;
mod last_round;
pub mod ledger_index;
mod needed_blobs;
pub mod presence;
pub mod public_samples;
pub mod request_error;
