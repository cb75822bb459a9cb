//! Guest cycles and gas of claims for each profile and mode, on private inputs from a fixed seed.
//!
//! `circuits/CYCLES.json` holds the figures; a test fails when they grow.

use crate::program::{synthetic, ExecuteError, Executor};
use serde::{Deserialize, Serialize};
use zk0_circuits::{EvalSpec, Mode};

/// A claim to measure.
#[derive(Clone, Copy, Debug)]
pub struct Case {
    /// Name of the dimensions.
    pub profile: &'static str,
    /// How the claim is proven.
    pub mode: Mode,
    /// Samples evaluated.
    pub samples: u32,
}

/// One line of `circuits/CYCLES.json`.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct CycleCount {
    /// Name of the dimensions.
    pub profile: String,
    /// How the claim is proven.
    pub mode: String,
    /// Samples evaluated.
    pub samples: u32,
    /// Guest instructions.
    pub cycles: u64,
    /// SP1's estimate of proving cost.
    pub gas: u64,
}

/// All that `make cycles` measures, quickest first.
pub fn cases() -> Vec<Case> {
    [
        ("micro", Mode::Direct, 6),
        ("micro", Mode::Succinct, 6),
        ("full", Mode::Succinct, 4),
        ("full", Mode::Succinct, 16),
    ]
    .map(|(profile, mode, samples)| Case {
        profile,
        mode,
        samples,
    })
    .to_vec()
}

/// Executes a claim made from a seed.
pub async fn measure(executor: &Executor, case: Case) -> Result<CycleCount, ExecuteError> {
    let spec = EvalSpec::new(synthetic::dims(case.profile).map_err(ExecuteError::Failed)?);
    let (_, run) = synthetic::execute(executor, &spec, case.mode, case.samples).await?;
    Ok(CycleCount {
        profile: case.profile.into(),
        mode: case.mode.to_string(),
        samples: case.samples,
        cycles: run.cycles,
        gas: run.gas,
    })
}
