//! This machine's prover.
//!
//! Its start takes minutes (SP1 derives its recursion programs) and gigabytes, so a process keeps one [`Sp1Prover`], and a
//! [lock](ProverLock) excludes other processes. SP1 blocks, so it runs on its own threads.

use super::engine::{self, ProverEngine};
use super::program_key::{check_program, OtherProgram};
use super::proof::Proof;
use super::verified::verified;
use crate::machine::{Device, LockError, ProverLock};
use crate::program::{carried, stdin, GuestInput, LacksProgram};
use sp1_sdk::SP1ProvingKey;
use std::sync::Arc;
use tokio::sync::Mutex;
use tokio::task::spawn_blocking;
use zk0_circuits::Mode;

/// Why there is no proof.
#[derive(Debug, thiserror::Error)]
pub enum ProveError {
    /// Another process proves.
    #[error(transparent)]
    Lock(#[from] LockError),
    /// Verifiers expect another program than the ELF.
    #[error(transparent)]
    OtherProgram(#[from] OtherProgram),
    /// SP1 failed. Its log has details.
    #[error("SP1 could not {doing}: {reason}")]
    Sp1 {
        /// The failed step.
        doing: &'static str,
        /// SP1's error.
        reason: String,
    },
    /// A verifier would refuse SP1's proof.
    #[error("SP1 made a proof that does not verify: {0}")]
    Unsound(String),
}

/// This machine's one prover.
pub struct Sp1Prover {
    sp1: Arc<Sp1>,
    /// One proof at a time.
    proving: Arc<Mutex<()>>,
}

struct Sp1 {
    engine: Box<dyn ProverEngine>,
    /// All carried programs, each with its verifying key.
    programs: Vec<(&'static [u8; 32], SP1ProvingKey)>,
    _lock: Arc<ProverLock>,
}

impl Sp1Prover {
    /// Starts SP1 on `device` for all carried programs, whose verifying keys must be the recorded ones. Takes one to two minutes on two
    /// cores.
    pub async fn start(device: Device, lock: Arc<ProverLock>) -> Result<Self, ProveError> {
        let failed = |reason| ProveError::Sp1 {
            doing: "start",
            reason,
        };
        let sp1 = spawn_blocking(move || {
            let engine = engine::start(device).map_err(failed)?;
            let mut programs = Vec::new();
            for (key, elf) in Mode::ALL.into_iter().flat_map(carried) {
                let program = engine.setup(elf).map_err(failed)?;
                check_program(&program, key)?;
                programs.push((key, program));
            }
            Ok::<_, ProveError>(Sp1 {
                engine,
                programs,
                _lock: lock,
            })
        });
        let sp1 = sp1.await.map_err(|panic| failed(panic.to_string()))??;
        Ok(Self {
            sp1: Arc::new(sp1),
            proving: Arc::default(),
        })
    }

    /// Proves that the program accepts `input`, and verifies the proof as a verifier would. Run an [`Executor`](crate::program::Executor)
    /// first: a refused input costs minutes here, and the error gives no reason.
    pub async fn prove_compressed(&self, input: &GuestInput) -> Result<Proof, ProveError> {
        let turn = self.proving.clone().lock_owned().await;
        let (sp1, program) = (self.sp1.clone(), input.program.clone());
        let stdin = stdin(&input.buffers);
        let work = spawn_blocking(move || {
            // The work itself holds the turn. If a caller stops waiting, no second proof starts beside it.
            let _turn = turn;
            sp1.prove(program, stdin)
        });
        work.await.map_err(|panic| proving(panic.to_string()))?
    }
}

impl Sp1 {
    fn prove(&self, program: Vec<u8>, stdin: sp1_sdk::SP1Stdin) -> Result<Proof, ProveError> {
        let found = self.programs.iter().find(|(key, _)| key[..] == program[..]);
        let (key, program) = found.ok_or_else(|| proving(LacksProgram(program).to_string()))?;
        let proven = self.engine.prove(program, stdin).map_err(proving)?;
        verified(key, &proven.proof, proven.public_values.to_vec()).map_err(ProveError::Unsound)
    }
}

fn proving(reason: String) -> ProveError {
    ProveError::Sp1 {
        doing: "prove",
        reason,
    }
}
