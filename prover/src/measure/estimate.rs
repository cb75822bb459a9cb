//! A claim's cost on this machine, for the operator: cycles, memory and time.
//!
//! The guest program runs on two and on three random samples with random weights of the claim's dimensions. Each further sample costs as
//! much as the third. Real samples cost at most that: their prefixes are not longer, and values affect only a few cycles in ten thousand.

use crate::machine::{check_disk, check_memory, free_disk, ProverOptions, Resources};
use crate::program::{synthetic, ExecuteError, Executor};
use crate::service::schedule::{expected_on, Work};
use serde::Serialize;
use std::env::temp_dir;
use zk0_argument::claim::Cost;
use zk0_circuits::{EvalSpec, Mode};

/// One claim's cost.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Estimate {
    /// `direct` or `succinct`.
    pub mode: String,
    /// Samples evaluated, each under both sets of weights.
    pub samples: u32,
    /// Guest instructions.
    pub cycles: u64,
    /// SP1's estimate of proving cost, precompiles included.
    pub gas: u64,
    /// Bytes of the private input.
    pub private_input_bytes: u64,
    /// Free memory for a proof, in bytes.
    pub memory_needed_bytes: u64,
    /// Free memory, in bytes.
    pub memory_free_bytes: u64,
    /// Hardware threads.
    pub cores: usize,
    /// Seconds until the proving service is ready, once.
    pub start_seconds: f64,
    /// Seconds of a proof on the CPU.
    pub proving_seconds: f64,
    /// The argument before the proof, in mode `succinct`.
    pub argument: Option<ArgumentEstimate>,
}

/// The cost of a node's argument in mode `succinct`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct ArgumentEstimate {
    /// Seconds on this machine.
    pub seconds: f64,
    /// Peak memory, in bytes.
    pub memory_bytes: u64,
    /// The argument's files in the node's state folder, in bytes.
    pub file_bytes: u64,
}

/// Cores for the seconds of [`Cost`].
const CORES: f64 = 2.0;

/// Most samples of an executed claim.
const EXECUTED: u32 = 3;

impl ArgumentEstimate {
    /// Checks the room for the arguments.
    fn of(spec: &EvalSpec, samples: u32, machine: Resources) -> Result<Self, ExecuteError> {
        let failed = |error: &dyn std::fmt::Display| {
            ExecuteError::Failed(format!(
                "zk0 counts the cycles of arguments about 2 and {EXECUTED} samples, and cannot make them here: {error}"
            ))
        };
        let executed = Cost::of(spec, EXECUTED, false);
        check_memory(&executed, machine).map_err(|error| failed(&error))?;
        let free = free_disk(&temp_dir()).map_err(|error| failed(&error))?;
        check_disk(&executed, &temp_dir(), free).map_err(|error| failed(&error))?;
        let cost = Cost::of(spec, samples, false);
        Ok(Self {
            seconds: cost.seconds * CORES / machine.cores.max(1) as f64,
            memory_bytes: cost.memory,
            file_bytes: cost.files,
        })
    }
}

impl Estimate {
    /// Counts the cycles of a claim over `samples` samples, from 2 to [`zk0_circuits::claim::challenge::MAX_EVAL_SAMPLES`], and derives
    /// memory and time. Takes seconds for small models. Mode `succinct` makes the arguments: ten minutes and 10 GB at the published size.
    pub async fn of(
        executor: &Executor,
        spec: &EvalSpec,
        mode: Mode,
        samples: u32,
        machine: Resources,
    ) -> Result<Self, ExecuteError> {
        let argument = match mode {
            Mode::Succinct => Some(ArgumentEstimate::of(spec, samples, machine)?),
            _ => None,
        };
        let (input, first) = synthetic::execute(executor, spec, mode, 2).await?;
        let (mut cycles, mut gas, mut private_input_bytes) =
            (first.cycles, first.gas, input.bytes());
        if samples > 2 {
            let (input, second) = synthetic::execute(executor, spec, mode, EXECUTED).await?;
            let further = |two: u64, three: u64| three.saturating_sub(two) * (samples as u64 - 2);
            cycles += further(first.cycles, second.cycles);
            gas += further(first.gas, second.gas);
            private_input_bytes += further(private_input_bytes, input.bytes());
        }
        Ok(Self {
            mode: mode.to_string(),
            samples,
            cycles,
            gas,
            private_input_bytes,
            memory_needed_bytes: ProverOptions::NEEDED,
            memory_free_bytes: machine.memory,
            cores: machine.cores,
            start_seconds: expected_on(machine.cores, Work::Start),
            proving_seconds: expected_on(machine.cores, Work::Proof { cycles }),
            argument,
        })
    }

    /// Whether this machine has enough memory.
    pub fn fits(&self) -> bool {
        self.memory_needed_bytes <= self.memory_free_bytes
    }
}
