//! The entry that founds a network; the network's id and the log's origin.

use crate::public_key::public_key;
use crate::quote::short;
use crate::rules::network_rules::Rules;
use crate::tlog::checkpoint::{log_key, CheckpointError};
use crate::tlog::names::{is_log_name, MAX_NAME_BYTES};
use crate::tlog::verifier_key::VerifierKey;
use borsh::{BorshDeserialize, BorshSerialize};
use zk0_circuits::model::spec::EvalSpec;
use zk0_circuits::vm::digest::tagged_sha256;
use zk0_circuits::{Digest, Mode, WeightsDigest};

/// The founding document. Its digest is the network id.
#[derive(Clone, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct Genesis {
    /// A readable name, also the origin line of checkpoints.
    pub name: String,
    /// ed25519 key that signs checkpoints.
    pub log_key: [u8; 32],
    /// A random value: networks with the same rules have different ids.
    pub nonce: [u8; 32],
    /// The first rules.
    pub rules: Rules,
    /// Verifying key of the proof program (SP1 `hash_koalabear`, encoded as in `zk0_circuits::claim::program`).
    pub program: Vec<u8>,
    /// How that program proves matrix products.
    pub mode: Mode,
    /// The evaluation specification, `zk0_circuits::model::spec::EvalSpec` in canonical encoding.
    pub evaluation: Vec<u8>,
    /// SHA-256 of the whole initial policy (safetensors), frozen part and expert.
    pub policy: Digest,
    /// The expert weights of round 0.
    pub initial: WeightsDigest,
}

impl Genesis {
    /// The network id: [`tagged_sha256`] of the genesis' borsh encoding under `zk0/genesis/v2`.
    pub fn network_id(&self) -> Digest {
        let bytes = borsh::to_vec(self).expect("writing to a Vec cannot fail");
        tagged_sha256("zk0/genesis/v2", &[&bytes])
    }

    /// The origin line and key name of checkpoints (C2SP tlog-checkpoint): the network's name.
    pub fn origin(&self) -> &str {
        &self.name
    }

    /// The key of the log's checkpoints.
    pub fn verifier_key(&self) -> Result<VerifierKey, CheckpointError> {
        log_key(self.origin(), &self.log_key)
    }

    /// The evaluation specification, if valid and canonical.
    pub fn evaluation_spec(&self) -> Result<EvalSpec, String> {
        let spec =
            EvalSpec::decode(&self.evaluation).map_err(|error| format!("evaluation: {error}"))?;
        if spec.encode() == self.evaluation {
            Ok(spec)
        } else {
            Err("evaluation: not in its canonical encoding".into())
        }
    }

    /// Checks every value. The error names a bad one.
    pub fn check(&self) -> Result<(), String> {
        if !is_log_name(&self.name) {
            return Err(format!(
                "name '{}' cannot be a log's name, which has 1 to {MAX_NAME_BYTES} bytes, no spaces, no '+', no control characters",
                short(&self.name)
            ));
        }
        public_key(&self.log_key).ok_or("log_key is not an ed25519 public key")?;
        self.evaluation_spec()?;
        self.rules.check_in(self.mode)
    }
}
