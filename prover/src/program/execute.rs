//! Runs a guest program without a proof, in a second, for its public values and cycles.

use sp1_sdk::blocking::{LightProver, Prover};
use sp1_sdk::{
    Elf, ExecutionReport, HashableKey, ProvingKey, SP1ProvingKey, SP1Stdin, SP1VerifyingKey,
};
use tokio::sync::watch;

/// The result of a run.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Execution {
    /// The program's commitment: borsh([`zk0_circuits::Claim`]).
    pub public_values: Vec<u8>,
    /// The RISC-V instructions run. Proving time grows with them.
    pub cycles: u64,
    /// SP1's estimate of proving cost, precompiles included.
    pub gas: u64,
}

/// Why there are no public values.
#[derive(Debug, thiserror::Error)]
pub enum ExecuteError {
    /// The program ended with an error: the statement does not hold.
    #[error("the guest program refuses the input: {0}")]
    Refused(String),
    /// SP1 did not run the program.
    #[error("SP1 cannot execute the guest program: {0}")]
    Failed(String),
}

/// A program's verifying key in both forms that verifiers use.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct VerifyingKey {
    /// bincode of `vk.hash_koalabear()`, for compressed proofs.
    pub koalabear: Vec<u8>,
    /// `vk.bytes32()`, hexadecimal with 0x, for Groth16 and PLONK proofs.
    pub bytes32: String,
}

impl VerifyingKey {
    pub(crate) fn of(key: &SP1VerifyingKey) -> bincode::Result<Self> {
        Ok(Self {
            koalabear: bincode::serialize(&key.hash_koalabear())?,
            bytes32: key.bytes32(),
        })
    }
}

/// SP1's executor, without proofs. Starts in about a second. Clones share it.
#[derive(Clone)]
pub struct Executor {
    client: LightProver,
}

impl Executor {
    /// Starts the executor.
    pub async fn new() -> Result<Self, ExecuteError> {
        let client = blocking(|| Ok(LightProver::new())).await?;
        Ok(Self { client })
    }

    /// Runs `elf` on `input`, one buffer per guest read.
    pub async fn execute(
        &self,
        elf: &'static [u8],
        input: &[Vec<u8>],
    ) -> Result<Execution, ExecuteError> {
        let (client, stdin) = (self.client.clone(), stdin(input));
        blocking(move || {
            let (stderr, last_words) = watch::channel(String::new());
            let (public_values, report) = client
                .execute(Elf::Static(elf), stdin)
                .stderr(stderr)
                .run()
                .map_err(failed)?;
            if report.exit_code != 0 {
                return Err(ExecuteError::Refused(panic_message(&last_words.borrow())));
            }
            Ok(Execution {
                public_values: public_values.to_vec(),
                cycles: report.total_instruction_count(),
                gas: gas(&report)?,
            })
        })
        .await
    }

    /// Derives the verifying key of `elf` in seconds.
    pub async fn verifying_key(&self, elf: &'static [u8]) -> Result<VerifyingKey, ExecuteError> {
        let program = self.set_up(elf).await?;
        VerifyingKey::of(program.verifying_key()).map_err(failed)
    }

    pub(crate) async fn set_up(&self, elf: &'static [u8]) -> Result<SP1ProvingKey, ExecuteError> {
        let client = self.client.clone();
        blocking(move || client.setup(Elf::Static(elf)).map_err(failed)).await
    }
}

fn failed(error: impl ToString) -> ExecuteError {
    ExecuteError::Failed(error.to_string())
}

/// Runs SP1 on a thread that may block; panics become errors.
async fn blocking<T: Send + 'static>(
    work: impl FnOnce() -> Result<T, ExecuteError> + Send + 'static,
) -> Result<T, ExecuteError> {
    tokio::task::spawn_blocking(work)
        .await
        .unwrap_or_else(|panic| Err(ExecuteError::Failed(panic.to_string())))
}

/// The guest's input stream: one unframed entry per buffer, as `sp1_zkvm::io::read_vec` reads it.
pub(crate) fn stdin(input: &[Vec<u8>]) -> SP1Stdin {
    let mut stdin = SP1Stdin::new();
    for buffer in input {
        stdin.write_slice(buffer);
    }
    stdin
}

fn gas(report: &ExecutionReport) -> Result<u64, ExecuteError> {
    report
        .gas()
        .ok_or_else(|| ExecuteError::Failed("no gas was calculated".into()))
}

/// The message of a Rust panic, in one line, without its source and its repetition by the guest's runtime.
fn panic_message(stderr: &str) -> String {
    let text = match stderr.split_once("panicked at ") {
        Some((_, rest)) => rest.split_once('\n').map_or(rest, |(_, message)| message),
        None => stderr,
    };
    match text.lines().find(|line| !line.trim().is_empty()) {
        Some(message) => message.trim().into(),
        None => "it ended without a message".into(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_panic_is_reported_without_its_source_line() {
        let stderr =
            "\nthread 'main' panicked at src/direct.rs:9:5:\nthe loss did not fall\nthe loss did not fall\n";
        assert_eq!(panic_message(stderr), "the loss did not fall");
        assert_eq!(panic_message(""), "it ended without a message");
        assert_eq!(panic_message("out of memory\n"), "out of memory");
    }
}
