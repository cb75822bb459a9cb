//! What follows from a genesis: the network's id, the log's origin, and whether it can found a network at all.

use crate::{
    checkpoint::{log_key, CheckpointError},
    entry::Genesis,
    public_key::PublicKey,
    verifier_key::{check_name, short, VerifierKey},
};
use zk0_circuits::{digest::tagged_sha256, spec::EvalSpec, Digest, NodeId};

/// Longest name of a network or a node, in bytes.
pub const MAX_NAME_BYTES: usize = 128;

impl Genesis {
    /// The network id: [`tagged_sha256`] of the genesis' borsh encoding under `zk0/genesis/v1`.
    pub fn network_id(&self) -> Digest {
        let bytes = borsh::to_vec(self).expect("writing to a Vec cannot fail");
        tagged_sha256("zk0/genesis/v1", &[&bytes])
    }

    /// The origin line and key name of the log's checkpoints (C2SP tlog-checkpoint): the network's name.
    pub fn origin(&self) -> &str {
        &self.name
    }

    /// The key that the log's checkpoints are verified with.
    pub fn verifier_key(&self) -> Result<VerifierKey, CheckpointError> {
        log_key(self.origin(), &self.log_key)
    }

    /// The evaluation specification, if it is a valid one in its canonical encoding.
    pub fn evaluation_spec(&self) -> Result<EvalSpec, String> {
        let spec =
            EvalSpec::decode(&self.evaluation).map_err(|error| format!("evaluation: {error}"))?;
        match spec.encode() == self.evaluation {
            true => Ok(spec),
            false => Err("evaluation: not in its canonical encoding".into()),
        }
    }

    /// Refuses a genesis no network can live by; the text says which value, and why.
    pub fn check(&self) -> Result<(), String> {
        check_name(&self.name).map_err(|_| {
            format!(
                "name '{}' cannot name a log: 1 to {MAX_NAME_BYTES} bytes, no spaces, no '+', no control characters",
                short(&self.name)
            )
        })?;
        PublicKey::from_bytes(&self.log_key).ok_or("log_key is not an ed25519 public key")?;
        self.evaluation_spec()?;
        self.rules.check()
    }
}

/// Refuses an identity that is no key, or one that anybody can sign for. Takes as long as a tenth of a signature.
pub(crate) fn check_identity(key: &NodeId) -> Result<(), String> {
    match PublicKey::from_bytes(&key.0) {
        Some(_) => Ok(()),
        None => Err("its identity is not an ed25519 public key".into()),
    }
}

/// Refuses a name that people cannot read.
pub(crate) fn check_member_name(name: &str) -> Result<(), String> {
    check_line("its name", name, MAX_NAME_BYTES)
}

/// Refuses what is not one line of text.
pub(crate) fn check_line(what: &str, text: &str, most: usize) -> Result<(), String> {
    match text.is_empty() || text.len() > most || text.chars().any(char::is_control) {
        true => Err(format!(
            "{what} has {} bytes; 1 to {most} without control characters are allowed",
            text.len()
        )),
        false => Ok(()),
    }
}
