//! What claims cost: guest cycles and gas for each profile and mode, on private inputs made from a fixed seed.
//!
//! `circuits/CYCLES.json` holds the committed figures; a test fails when they grow.

use crate::program::{elf, synthetic, ExecuteError, Executor, GuestInput};
use serde::{Deserialize, Serialize};
use zk0_circuits::model::spec::Dims;
use zk0_circuits::{EvalSpec, Mode};

/// A claim that is measured.
#[derive(Clone, Copy, Debug)]
pub struct Case {
    /// Name of the dimensions.
    pub profile: &'static str,
    /// The dimensions.
    pub dims: Dims,
    /// How matrix products are proven.
    pub mode: Mode,
    /// Samples evaluated.
    pub samples: u32,
}

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

/// All that `make cycles` measures, the quick ones first.
pub fn cases() -> Vec<Case> {
    let (micro, full) = (("micro", Dims::MICRO), ("full", Dims::FULL));
    [
        (micro, Mode::Direct, 4),
        (micro, Mode::Checked, 4),
        (full, Mode::Checked, 1),
        (full, Mode::Checked, 4),
    ]
    .map(|((profile, dims), mode, samples)| Case {
        profile,
        dims,
        mode,
        samples,
    })
    .to_vec()
}

/// Makes a private input and executes its program. At full size that takes a minute and half a gigabyte for every sample.
pub async fn measure(executor: &Executor, case: Case) -> Result<Cost, ExecuteError> {
    let private = synthetic::private_input(&EvalSpec::new(case.dims), case.samples, 1)
        .map_err(ExecuteError::Failed)?;
    let (_, input) = GuestInput::of(case.mode, &private)
        .map_err(|error| ExecuteError::Failed(error.to_string()))?;
    drop(private);
    let run = executor.execute(elf(case.mode), &input.buffers).await?;
    Ok(Cost {
        profile: case.profile.into(),
        mode: case.mode.to_string(),
        samples: case.samples,
        cycles: run.cycles,
        gas: run.gas,
    })
}
