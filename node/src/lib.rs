//! A node's side of a round: its recording, training, commitment, proof and submission.
//!
//! A short tour:
//! - [`participant`]: a node's life in a network, round after round, and what can end it ([`error`]); [`turn`]: its part in one
//!   round.
//! - [`recording`]: its data, prepared and committed to; [`progress`]: how long work reports how far it is.
//! - [`client`]: its dealings with the aggregator, and why they fail ([`client_error`]).
//! - [`state_files`]: what it keeps from start to start; [`base_losses`]: the losses that its learning rate follows;
//!   [`training_history`] and [`receipts`].

pub mod base_losses;
pub mod client;
pub mod client_error;
pub mod error;
pub mod participant;
pub mod progress;
pub mod receipts;
pub mod recording;
pub mod state_files;
pub mod training_history;
pub mod turn;
