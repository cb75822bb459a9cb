//! What follows from a genesis: the network's id, the log's origin, and whether it can found a network at all.

use crate::{
    checkpoint::{log_key, CheckpointError},
    entry::Genesis,
    verifier_key::{check_name, short, VerifierKey},
};
use ed25519_dalek::VerifyingKey;
use zk0_circuits::{challenge::MAX_EVAL_SAMPLES, digest::tagged_sha256, spec::EvalSpec, Digest};

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
                "name {:?} cannot name a log: 1 to {MAX_NAME_BYTES} bytes, no spaces, no '+', no control characters",
                short(&self.name)
            )
        })?;
        match VerifyingKey::from_bytes(&self.log_key) {
            Ok(key) if !key.is_weak() => {}
            _ => return Err("log_key is not an ed25519 public key".into()),
        }
        self.evaluation_spec()?;
        let rules = &self.rules;
        let at_least_one = [
            ("min_dataset_samples", rules.min_dataset_samples),
            ("eval_samples", rules.eval_samples.into()),
            ("min_improvement_bps", rules.min_improvement_bps.into()),
            ("max_weight_samples", rules.max_weight_samples),
            ("commit_window_ms", rules.commit_window_ms),
            ("max_update_bytes", rules.max_update_bytes),
            ("max_proof_bytes", rules.max_proof_bytes),
        ];
        if let Some((rule, _)) = at_least_one.iter().find(|(_, value)| *value == 0) {
            return Err(format!("rule {rule} is 0, it has to be at least 1"));
        }
        if rules.min_improvement_bps > 10_000 {
            return Err(format!(
                "rule min_improvement_bps is {}, a loss cannot fall by more than 10000",
                rules.min_improvement_bps
            ));
        }
        if rules.eval_samples > MAX_EVAL_SAMPLES
            || u64::from(rules.eval_samples) > rules.min_dataset_samples
        {
            return Err(format!(
                "rule eval_samples is {}, it can be at most {MAX_EVAL_SAMPLES} and at most min_dataset_samples, {}",
                rules.eval_samples, rules.min_dataset_samples
            ));
        }
        if rules.submit_window_ms < rules.commit_window_ms {
            return Err(format!(
                "rule submit_window_ms is {}, shorter than commit_window_ms, {}",
                rules.submit_window_ms, rules.commit_window_ms
            ));
        }
        Ok(())
    }
}
