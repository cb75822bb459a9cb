//! Why a node cannot go on.

use crate::client_error::NodeError;
use std::io;
use std::path::PathBuf;
use zk0_circuits::claim::challenge::DrawError;
use zk0_circuits::Digest;
use zk0_prover::machine::NoRoom;
use zk0_prover::program::NotProvable;
use zk0_prover::service::ClientError;
use zk0_smolvla::frames::prefix_cache::CacheError;
use zk0_smolvla::PolicyError;

const MB: f64 = 1e6;

/// Why there is no proof when a round takes no more submissions.
#[derive(Debug, thiserror::Error)]
pub enum NoProof {
    /// The proving service has failed, and a further try would come too late.
    #[error("{0}")]
    Failed(Box<ClientError>),
    /// The proving service has sent nothing.
    #[error("the proving service needs longer than the round takes submissions, or has too many other claims to prove first")]
    Unfinished,
}

/// Why a node cannot go on.
#[derive(Debug, thiserror::Error)]
pub enum ParticipantError {
    /// The recording cannot be read.
    #[error("the recording: {0}")]
    Dataset(#[from] zk0_lerobot::dataset::DatasetError),
    /// The recording cannot be read, or does not fit the policy.
    #[error("the recording: {0}")]
    Prepare(#[from] zk0_smolvla::frames::recording::PrepareError),
    /// The cache of prepared samples fails.
    #[error(transparent)]
    Cache(CacheError),
    /// The policy, its weights, or training fails.
    #[error("the policy: {0}")]
    Policy(#[source] PolicyError),
    /// A value is outside the evaluation's ranges.
    #[error("a value does not fit into the network's fixed-point numbers: {0}")]
    Quantise(#[from] zk0_circuits::model::quantise::QuantiseError),
    /// The round's base weights cannot be read.
    #[error("the round's base weights: {0}")]
    Weights(#[from] zk0_weights::WeightFileError),
    /// The network's evaluation specification cannot be read.
    #[error("the network's evaluation specification: {0}")]
    Spec(#[from] zk0_circuits::model::spec::SpecError),
    /// The recording does not fit the rules.
    #[error(
        "the recording is not like the others of this network, as its rules ask (`recordings`): {0}. One policy cannot learn from both: convert \
         the recording, or join another network"
    )]
    OtherRecording(String),
    /// Policy and evaluation specification have different dimensions.
    #[error("the network's policy and its evaluation specification have different dimensions, so nobody can take part: tell its operator")]
    Dimensions,
    /// The number of samples does not fit the rules or the evaluation set.
    #[error(
        "{asked} samples are too {} for round {round}: the rules ask for {least} to {allowed} samples a claim, and this node's evaluation set has {held}; start the node with --eval-samples between {least} and {}, or without --eval-samples for {least}",
        match asked < least { true => "few", false => "many" },
        held.min(&u64::from(*allowed))
    )]
    EvalSamples {
        /// The round.
        round: u64,
        /// Samples asked for.
        asked: u32,
        /// Fewest by the rules.
        least: u32,
        /// Most by the rules.
        allowed: u32,
        /// Size of the evaluation set.
        held: u64,
    },
    /// A claim cannot evaluate so many samples.
    #[error(
        "a claim about a policy of this size has at most {most} samples in mode succinct, and this one would have {asked}: start the node with \
         --eval-samples {most} or less; where the rules ask for more, a vote has to change min_eval_samples"
    )]
    TooManyToProve {
        /// Samples asked for.
        asked: u32,
        /// Most samples of a claim.
        most: u32,
    },
    /// The frames of the evaluation set cannot be drawn.
    #[error("the evaluation set: {0}")]
    Frames(DrawError),
    /// A committed sample is damaged, and the recording gives another one now.
    #[error("{damaged}; and frame {frame} of the recording gives another sample now: put the file or the recording back from a backup")]
    OtherSample {
        /// The frame in the recording.
        frame: usize,
        /// What is wrong with the file.
        damaged: String,
    },
    /// The samples of the challenge cannot be drawn.
    #[error("the challenge: {0}")]
    Draw(#[from] DrawError),
    /// The update does not improve by as much as the rules ask, or the network's mode cannot prove it.
    #[error("the update cannot be proven: {0}")]
    NotProvable(#[from] NotProvable),
    /// This machine has no room for the network's mode.
    #[error(transparent)]
    NoRoom(#[from] NoRoom),
    /// The state folder has no room for an update.
    #[error(
        "the update needs {:.1} MB of disk, and {} has {:.1} MB free: free some, or move the state folder to another disk",
        *needed as f64 / MB, folder.display(), *free as f64 / MB
    )]
    NoRoomForUpdate {
        /// The state folder.
        folder: PathBuf,
        /// Bytes needed.
        needed: u64,
        /// Bytes free.
        free: u64,
    },
    /// The file with the secret and its counts is lost or damaged.
    #[error(
        "{why}. Without it the node does not know how often it has opened its samples, and proves nothing more about them. To register the recording again, under a fresh secret, move the files `secret` and `registration` out of {}, and start the node again",
        folder.display()
    )]
    NoSecret {
        /// The state folder.
        folder: PathBuf,
        /// What is wrong with the file.
        why: String,
    },
    /// A further argument would show a sample.
    #[error(
        "{opened} arguments have opened sample {leaf} of the evaluation set, and no more than that hide it, so the node makes no further one about it. The node registers its recording again by itself, under a fresh secret. If it cannot (its log states why), move the files `secret` and `registration` out of {}, and start it again",
        folder.display()
    )]
    WornOut {
        /// Its index.
        leaf: u64,
        /// Arguments that opened it.
        opened: u32,
        /// The state folder.
        folder: PathBuf,
    },
    /// A request to the aggregator fails.
    #[error(transparent)]
    Node(#[from] NodeError),
    /// A request to the proving service fails.
    #[error(transparent)]
    Prover(#[from] ClientError),
    /// The proving service made no proof in time.
    #[error(
        "round {round}: the node has no proof in time, and goes on with the next round: {why}"
    )]
    NoProofInTime {
        /// The round.
        round: u64,
        /// Why there is no proof.
        why: NoProof,
    },
    /// An option does not go with SCAFFOLD.
    #[error("the rules of round {round} ask for SCAFFOLD, which does not go with {option}: start the node without it")]
    BesideScaffold {
        /// The round.
        round: u64,
        /// The option.
        option: &'static str,
    },
    /// The loss of the base weights is no number, and the rates follow it.
    #[error("the loss of round {round}'s base weights is {loss}, so --follow-losses and --lr-boost give no rates")]
    BaseLoss {
        /// The round.
        round: u64,
        /// The loss.
        loss: f32,
    },
    /// The commitments closed before the node has trained.
    #[error("round {round}: the node came too late, and goes on with the next round: the commitments are closed")]
    TooLate {
        /// The round.
        round: u64,
    },
    /// The node has not kept a file that the aggregator has lost.
    #[error("round {round}: the node has no update of this round in its state folder")]
    NotKept {
        /// The round.
        round: u64,
    },
    /// The control variates for SCAFFOLD need weights that cannot be downloaded.
    #[error("round {round}: the node leaves the round out, because it cannot compute its control variates for SCAFFOLD: the weights {blob} cannot be downloaded: {error}. It needs them until the control variates begin again, in round {begins}")]
    NoControlVariates {
        /// The round.
        round: u64,
        /// The weights' file.
        blob: Digest,
        /// Why not.
        error: Box<NodeError>,
        /// The latest round that begins them again.
        begins: u64,
    },
    /// The log has signed two different entries with one index.
    #[error(
        "the log has signed two different entries {index}: keep both files, {} and {}, and show them to the auditors",
        kept.display(), beside.display()
    )]
    Forked {
        /// The index.
        index: u64,
        /// The older proof.
        kept: PathBuf,
        /// The newer proof.
        beside: PathBuf,
    },
    /// Another node uses the state folder.
    #[error(
        "another zk0 node uses {}: stop it first, or choose another folder with --state",
        folder.display()
    )]
    StateInUse {
        /// The state folder.
        folder: PathBuf,
    },
    /// The state folder has files of another release.
    #[error(
        "{} names version {found:?} of a node's files, and this release reads version {expected}: start the release of zk0 that wrote them, or choose another folder with --state; nothing there is changed",
        path.display()
    )]
    OtherVersion {
        /// The file with the version.
        path: PathBuf,
        /// The version in it.
        found: String,
        /// The version of this release.
        expected: &'static str,
    },
    /// A file of the node cannot be read or written.
    #[error("{path}: {error}")]
    File {
        /// The file.
        path: PathBuf,
        /// What the system reports.
        error: io::Error,
    },
    /// A file holds something that the node did not write.
    #[error("{path} is not what this node wrote there: {why}; to start without it, move it away")]
    BrokenFile {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        why: String,
    },
    /// The system gives no randomness.
    #[error("the system gives no random bytes: {0}")]
    Random(getrandom::Error),
}

impl From<CacheError> for ParticipantError {
    fn from(error: CacheError) -> Self {
        match error {
            CacheError::Prepare(error) => Self::Prepare(error),
            error => Self::Cache(error),
        }
    }
}

impl From<PolicyError> for ParticipantError {
    fn from(error: PolicyError) -> Self {
        match error {
            // This error names the file to mend.
            PolicyError::Recording { error, .. } => Self::Dataset(*error),
            error => Self::Policy(error),
        }
    }
}

impl ParticipantError {
    /// Whether only training failed: the next round may begin with better weights.
    pub fn is_of_training(&self) -> bool {
        match self {
            Self::Policy(error) => error.is_of_training(),
            Self::Quantise(_) | Self::BaseLoss { .. } => true,
            _ => false,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use zk0_lerobot::dataset::DatasetError;

    #[test]
    fn a_video_that_cannot_be_read_is_a_fault_of_the_recording() {
        let error = DatasetError::Video {
            path: "videos/top.mp4".into(),
            cause: "is cut off".into(),
        };
        let error = PolicyError::Recording {
            frame: 123,
            recording: 0,
            error: Box::new(error),
        };
        assert_eq!(
            ParticipantError::from(error).to_string(),
            "the recording: videos/top.mp4: is cut off"
        );
    }
}
