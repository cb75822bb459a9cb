//! Why a simulation cannot go on.

use std::io;
use zk0_circuits::model::spec::SpecError;
use zk0_node::error::ParticipantError;
use zk0_smolvla::PolicyError;
use zk0_verifier::combine::error::CombineError;
use zk0_weights::WeightFileError;

/// Why a simulation cannot go on.
#[derive(Debug, thiserror::Error)]
pub enum SimulationError {
    /// A node cannot train.
    #[error("round {round}, {node}: {error}")]
    Node {
        /// The round.
        round: u64,
        /// The node's name.
        node: String,
        /// What is wrong.
        error: Box<ParticipantError>,
    },
    /// The policy, a recording or an option does not fit.
    #[error(transparent)]
    Policy(#[from] PolicyError),
    /// Weights cannot be written as a network's.
    #[error(transparent)]
    Participant(Box<ParticipantError>),
    /// As above.
    #[error(transparent)]
    Weights(#[from] WeightFileError),
    /// The policy has dimensions that no network has.
    #[error("no network can have a policy of these dimensions: {0}")]
    Spec(#[from] SpecError),
    /// The updates cannot be combined.
    #[error(transparent)]
    Combine(#[from] CombineError),
    /// A rule has a value that no network accepts.
    #[error("{0}")]
    Rules(String),
    /// The nodes' data is not as it has to be.
    #[error("{0}")]
    Data(String),
    /// A saved simulation is of other options, or is damaged.
    #[error("{0}")]
    Saved(String),
    /// A file cannot be read or written.
    #[error("{what}: {error}")]
    File {
        /// Which file.
        what: String,
        /// What is wrong.
        error: io::Error,
    },
}

impl From<ParticipantError> for SimulationError {
    fn from(error: ParticipantError) -> Self {
        Self::Participant(Box::new(error))
    }
}
