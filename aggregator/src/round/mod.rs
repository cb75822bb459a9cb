//! The rounds of a network, and the ledger's one writer.

pub mod accepted;
pub mod aggregator;
pub mod closing;
pub mod dispute;
pub mod founding;
pub mod intake;
pub mod job;
pub mod ledger_index;
mod needed_blobs;
mod outage;
pub mod phase;
pub mod polling;
pub mod presence;
pub mod public_samples;
pub mod request_error;
