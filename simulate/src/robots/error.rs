//! Errors of a simulation.

use std::io;
use zk0_circuits::model::spec::SpecError;
use zk0_node::error::ParticipantError;
use zk0_smolvla::PolicyError;
use zk0_verifier::combine::error::CombineError;
use zk0_weights::WeightFileError;

/// Why a simulation stops.
#[derive(Debug, thiserror::Error)]
pub enum SimulationError {
    /// A node cannot train.
    #[error("round {round}, {node}: {error}")]
    Node {
        /// The round.
        round: u64,
        /// The node's name.
        node: String,
        /// The cause.
        error: Box<ParticipantError>,
    },
    /// A policy, recording or option does not fit.
    #[error(transparent)]
    Policy(#[from] PolicyError),
    /// No network accepts these weights.
    #[error(transparent)]
    Participant(Box<ParticipantError>),
    /// A weight file cannot be made.
    #[error(transparent)]
    Weights(#[from] WeightFileError),
    /// No network can have the policy's dimensions.
    #[error("no network can have a policy of these dimensions: {0}")]
    Spec(#[from] SpecError),
    /// The updates cannot be combined.
    #[error(transparent)]
    Combine(#[from] CombineError),
    /// No network accepts a rule's value.
    #[error("{0}")]
    Rules(String),
    /// The nodes' data is not usable.
    #[error("{0}")]
    Data(String),
    /// A saved simulation is another one, or damaged.
    #[error("{0}")]
    Saved(String),
    /// A file cannot be read or written.
    #[error("{what}: {error}")]
    File {
        /// The file.
        what: String,
        /// The cause.
        error: io::Error,
    },
}

impl From<ParticipantError> for SimulationError {
    fn from(error: ParticipantError) -> Self {
        Self::Participant(Box::new(error))
    }
}
