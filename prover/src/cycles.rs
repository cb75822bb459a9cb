//! What claims cost: guest cycles and gas per profile and mode, on witnesses made from a fixed seed.
//!
//! `circuits/CYCLES.json` holds the committed figures; a test fails when they grow.

use crate::{
    execute::{ExecuteError, Execution, Executor},
    program::{self, GuestInput},
    synthetic,
};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use zk0_circuits::{spec::Dims, statement::Mode, EvalSpec};

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

impl Case {
    fn cost(&self, run: &Execution) -> Cost {
        Cost {
            profile: self.profile.into(),
            mode: self.mode.to_string(),
            samples: self.samples,
            cycles: run.cycles,
            gas: run.gas,
        }
    }
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

/// Makes a witness and executes its program. At full size that takes a minute and half a gigabyte for every sample.
pub async fn measure(executor: &Executor, case: Case) -> Result<Cost, ExecuteError> {
    let run = run(executor, case, program::elf(case.mode)).await?;
    Ok(case.cost(&run))
}

/// What of a claim's cycles each operation takes, measured with a `program` that reports it, as `circuits/build-guest.sh
/// --budget` builds it. Reporting itself costs some.
#[derive(Clone, Debug, Serialize)]
pub struct Budget {
    /// The claim, and what it costs with this program.
    #[serde(flatten)]
    pub cost: Cost,
    /// Cycles per operation.
    pub operations: BTreeMap<String, u64>,
}

/// The [`Budget`] of a claim.
pub async fn budget(
    executor: &Executor,
    case: Case,
    program: &'static [u8],
) -> Result<Budget, ExecuteError> {
    let run = run(executor, case, program).await?;
    let mut operations = run.operations.clone();
    let named = operations.values().sum::<u64>();
    operations.insert("all else".into(), run.cycles.saturating_sub(named));
    Ok(Budget {
        cost: case.cost(&run),
        operations,
    })
}

async fn run(
    executor: &Executor,
    case: Case,
    program: &'static [u8],
) -> Result<Execution, ExecuteError> {
    let witness = synthetic::witness(&EvalSpec::new(case.dims), case.samples, 1);
    let witness = witness.map_err(ExecuteError::Failed)?;
    let (_, input) = GuestInput::of(case.mode, &witness)
        .map_err(|error| ExecuteError::Failed(error.to_string()))?;
    drop(witness);
    executor.execute(program, &input.buffers).await
}
