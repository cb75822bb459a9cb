//! The weight check: the bytes a node uploaded are the weights that its proof is about.

use crate::weights::{blob_digest, short, ExpertTensors};
use zk0_circuits::{
    spec::EvalSpec,
    weights::{expert_tensors, QuantisedWeights, TensorSpec},
    WeightsDigest,
};
use zk0_ledger::{state::State, Refusal};

/// What a network evaluates, and so which tensors its weights have.
#[derive(Clone, Debug)]
pub struct Evaluation {
    spec: EvalSpec,
    tensors: Vec<TensorSpec>,
}

impl Evaluation {
    /// The evaluation that a network's genesis fixes.
    pub fn of(state: &State) -> Result<Self, Refusal> {
        Self::decode(&state.genesis().evaluation)
    }

    /// Reads an evaluation specification in its canonical encoding.
    pub fn decode(bytes: &[u8]) -> Result<Self, Refusal> {
        let spec = EvalSpec::decode(bytes)
            .map_err(|error| Refusal::MalformedUpdate(format!("no rule to read it by: {error}")))?;
        let tensors = expert_tensors(&spec.dims);
        Ok(Self { spec, tensors })
    }

    /// The specification.
    pub fn spec(&self) -> &EvalSpec {
        &self.spec
    }

    /// Reads expert weights from a safetensors file.
    pub fn read(&self, bytes: &[u8]) -> Result<ExpertTensors, Refusal> {
        ExpertTensors::read(bytes, &self.tensors)
            .map_err(|error| Refusal::MalformedUpdate(error.to_string()))
    }

    /// The digest of weights that travel as the file `bytes`.
    pub fn digest(&self, bytes: &[u8], weights: &ExpertTensors) -> Result<WeightsDigest, Refusal> {
        let quantised = QuantisedWeights::quantise(&self.spec, |name| weights.get(name))
            .map_err(|error| Refusal::MalformedUpdate(short(&error.to_string())))?;
        Ok(WeightsDigest {
            blob: blob_digest(bytes),
            quantised: quantised.digest(),
        })
    }

    /// Checks that `bytes` are the weights named by `claimed`, as a file and, quantised anew, as numbers.
    pub fn check_update(
        &self,
        bytes: &[u8],
        claimed: &WeightsDigest,
    ) -> Result<ExpertTensors, Refusal> {
        let actual = blob_digest(bytes);
        if actual != claimed.blob {
            return Err(Refusal::UpdateDigest {
                expected: claimed.blob,
                actual,
            });
        }
        let weights = self.read(bytes)?;
        let actual = self.digest(bytes, &weights)?;
        if actual.quantised != claimed.quantised {
            return Err(Refusal::OtherWeights {
                proven: claimed.quantised,
                actual: actual.quantised,
            });
        }
        Ok(weights)
    }
}
