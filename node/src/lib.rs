//! A node's side of a round: its recording, training, commitment, proof and submission.
//!
//! A short tour:
//! - [`participant`]: takes part in a network, round after round; [`error`]: what can end that; [`turn`]: one node's part in one round;
//!   [`turn::prepared_claim`]: what it computes for a claim before SP1 starts; `turn::proving`: has it proven, and waits for the proving service.
//! - [`recording`]: the node's data, and the evaluation set that it commits to; [`samples`]: frames of recordings as samples, through the prefix cache;
//!   [`progress`]: how long work reports how far it is.
//! - [`exchanged_weights`]: between the float32 weights that a node trains and the int16 weights that travel.
//! - [`client`]: the connection to the aggregator; `client::watching`: the node is told when a round has come further; [`challenge`]: waits for the randomness and derives the challenge;
//!   [`client_error`]: why it fails; [`governance`]: proposals, votes, disputes and new
//!   keys.
//! - [`observe`]: its metrics, and what is wrong with it.
//! - [`state_files`]: the files that a node keeps, and the lock of their folder; among them [`turn::unfinished`] (what an interrupted node goes on with), [`base_losses`] (the losses that its learning rate follows),
//!   [`training_history`] and [`receipts`].

pub mod base_losses;
pub mod challenge;
pub mod client;
pub mod client_error;
pub mod error;
pub mod exchanged_weights;
pub mod governance;
pub mod observe;
pub mod participant;
pub mod progress;
pub mod receipts;
pub mod recording;
pub mod samples;
pub mod state_files;
pub mod training_history;
pub mod turn;
