//! Asks the witnesses of a policy that is not in force yet. Once it is, nothing is published without them.

use crate::publish::cosigning::{CosigningError, Witnesses};
use std::time::Duration;
use zk0_protocol::WitnessPolicy;

const PATIENCE: Duration = Duration::from_secs(5);

/// A policy that a proposal puts into force.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct NewWitnesses {
    /// The proposal's number.
    pub proposal: u64,
    /// The policy.
    pub policy: String,
    /// A checkpoint that the log has signed.
    pub checkpoint: Vec<u8>,
}

impl NewWitnesses {
    /// Asks the witnesses once, and logs what is missing: the vote decides all the same.
    pub fn ask(&self) {
        let policy = WitnessPolicy::parse(&self.policy).map_err(|error| error.to_string());
        let known = policy.and_then(|policy| {
            let known = know(policy, &self.checkpoint);
            known.map_err(|error| error.to_string())
        });
        if let Err(why) = known {
            let proposal = self.proposal;
            tracing::error!("proposal {proposal} puts a witness policy into force that is not met, so nothing will be published until it is, or a vote changes it: {why}");
        }
    }
}

/// Checks that the quorum of a policy cosigns the log that has signed this checkpoint. Asks each witness once. The system's trusted
/// certificates count.
///
/// # Errors
/// Too few witnesses do.
pub fn know(policy: WitnessPolicy, checkpoint: &[u8]) -> Result<(), CosigningError> {
    Witnesses::new(policy, PATIENCE)?.know(checkpoint)
}
