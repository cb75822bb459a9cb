//! The weight check: the bytes that a node uploaded are the weights that its proof is about.

use crate::projection::check_projections;
use crate::weights::ExpertTensors;
use zk0_circuits::model::layout::{expert_tensors, TensorSpec};
use zk0_circuits::model::spec::EvalSpec;
use zk0_circuits::model::weights::QuantisedWeights;
use zk0_circuits::{Claim, Mode, WeightsDigest};
use zk0_protocol::blob::blob_digest;
use zk0_protocol::entries::genesis::Genesis;
use zk0_protocol::rules::state::State;
use zk0_protocol::Refusal;

/// What a network evaluates. It determines the tensors that the network's weights have.
#[derive(Clone, Debug)]
pub struct Evaluation {
    spec: EvalSpec,
    mode: Mode,
    tensors: Vec<TensorSpec>,
}

impl Evaluation {
    /// The evaluation that a network's genesis fixes.
    pub fn of(state: &State) -> Result<Self, Refusal> {
        Self::of_genesis(state.genesis())
    }

    /// The evaluation that `genesis` fixes.
    pub fn of_genesis(genesis: &Genesis) -> Result<Self, Refusal> {
        let spec = EvalSpec::decode(&genesis.evaluation)
            .map_err(|error| Refusal::MalformedUpdate(format!("no rule to read it by: {error}")))?;
        Ok(Self::new(spec, genesis.mode))
    }

    /// An evaluation whose products are proven in `mode`.
    pub fn new(spec: EvalSpec, mode: Mode) -> Self {
        let tensors = expert_tensors(&spec.dims);
        Self {
            spec,
            mode,
            tensors,
        }
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

    /// The digest of weights whose file has these `bytes`.
    pub fn digest(&self, bytes: &[u8], weights: &ExpertTensors) -> Result<WeightsDigest, Refusal> {
        let quantised = QuantisedWeights::quantise(&self.spec, |name| weights.get(name))
            .map_err(|error| Refusal::MalformedUpdate(error.to_string()))?;
        Ok(WeightsDigest {
            blob: blob_digest(bytes),
            quantised: quantised.digest(self.mode),
        })
    }

    /// Checks, in mode `checked`, that the products behind `claim` are those with the weights in the files `base` (the round's)
    /// and `update`.
    pub fn check_products(&self, claim: &Claim, base: &[u8], update: &[u8]) -> Result<(), Refusal> {
        match (self.mode, &claim.weight_check) {
            (Mode::Direct, None) => Ok(()),
            (Mode::Checked, Some(check)) => {
                let actual = blob_digest(base);
                if actual != claim.terms.base.blob {
                    return Err(Refusal::UpdateDigest {
                        expected: claim.terms.base.blob,
                        actual,
                    });
                }
                check_projections(&self.spec, check, base, update)
            }
            (mode, check) => Err(Refusal::Binding {
                field: "weight_check".into(),
                claimed: if check.is_some() { "some" } else { "none" }.into(),
                expected: format!("that of mode {mode}"),
            }),
        }
    }

    /// Checks that `bytes` are the weights that `claimed` names: the digest of the file, and the digest of its quantised numbers.
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
