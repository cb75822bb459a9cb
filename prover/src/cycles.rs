//! What claims cost: guest cycles and gas per profile and mode, on witnesses made from a fixed seed.
//!
//! `circuits/CYCLES.json` holds the committed figures; a test fails when they grow.

use crate::{
    execute::{ExecuteError, Executor},
    program, synthetic,
};
use serde::{Deserialize, Serialize};
use zk0_circuits::EvalSpec;

/// One line of `circuits/CYCLES.json`.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Cost {
    /// Name of the dimensions.
    pub profile: String,
    /// How matrix products are proven.
    pub mode: String,
    /// Samples evaluated.
    pub samples: u32,
    /// Guest instructions.
    pub cycles: u64,
    /// SP1's estimate of proving cost.
    pub gas: u64,
}

/// Measures all profiles and modes.
pub async fn measure() -> Result<Vec<Cost>, ExecuteError> {
    let samples = 4;
    let witness =
        synthetic::witness(&EvalSpec::micro(), samples, 1).map_err(ExecuteError::Failed)?;
    let run = Executor::new()
        .await?
        .execute(program::DIRECT_ELF, &witness.to_buffers())
        .await?;
    Ok(vec![Cost {
        profile: "micro".into(),
        mode: "direct".into(),
        samples,
        cycles: run.cycles,
        gas: run.gas,
    }])
}
