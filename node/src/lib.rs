//! A node's side of a round: its recording, training, commitment, proof and submission.
//!
//! A short tour:
//! - [`participant`]: takes part in a network, round after round; [`error`]: what can end that; [`turn`]: one node's part in one round.
//! - [`recording`]: the node's data, prepared and committed to; [`samples`]: frames of recordings as samples, through the prefix cache;
//!   [`progress`]: how long work reports how far it is.
//! - [`client`]: the connection to the aggregator; [`client_error`]: why it fails; [`governance`]: proposals, votes, disputes and new
//!   keys.
//! - [`state_files`]: the files that a node keeps; among them [`base_losses`] (the losses that its learning rate follows),
//!   [`training_history`] and [`receipts`].

pub mod base_losses;
pub mod client;
pub mod client_error;
pub mod error;
pub mod governance;
pub mod participant;
pub mod progress;
pub mod receipts;
pub mod recording;
pub mod samples;
pub mod state_files;
pub mod training_history;
pub mod turn;
