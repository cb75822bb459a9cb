//! A node's side of a round: its recording, training, commitment, proof and submission.
//!
//! - [`participant`]: takes part in a network, round after round; [`error`]: what can end that; [`turn`]: one node's part in one round;
//!   [`turn::prepared_claim`]: what it computes before SP1 starts; `turn::proving`: waits for the proving service.
//! - [`recording`]: the node's data, and the evaluation set that it commits to; [`samples`]: frames as samples, through the prefix cache;
//!   [`progress`]: reports of long work.
//! - [`exchanged_weights`]: between float32 weights in training and int16 weights that travel.
//! - [`client`]: the connection to the aggregator; `client::watching`: follows a round; [`client::carried`]: waits for a guest program;
//!   [`challenge`]: verifies the randomness; [`client_error`]: why it fails; [`governance`]: proposals, votes, disputes and new keys.
//! - [`observe`]: metrics and troubles; [`tensorboard`]: curves as event files.
//! - [`state_files`]: files that a node keeps, and their lock; among them [`turn::unfinished`] (what an interrupted node goes on with),
//!   [`base_losses`] (what its learning rate follows), [`training_history`] and [`receipts`].

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
pub mod tensorboard;
pub mod training_history;
pub mod turn;
