//! SP1 on the CPU: the SDK's blocking prover, compiled once within `sp1-sdk`. Each crate that awaits the asynchronous one compiles it
//! again, for minutes.

use super::interface::ProverEngine;
use crate::machine::ProverOptions;
use sp1_sdk::blocking::{CpuProver, ProveRequest, Prover};
use sp1_sdk::{Elf, SP1ProofWithPublicValues, SP1ProvingKey, SP1Stdin};

pub(crate) struct Cpu {
    client: CpuProver,
}

impl Cpu {
    pub(crate) fn start(options: ProverOptions) -> Self {
        options.export();
        Self {
            client: CpuProver::new_with_opts(Some(options.core())),
        }
    }
}

impl ProverEngine for Cpu {
    fn setup(&self, elf: &'static [u8]) -> Result<SP1ProvingKey, String> {
        self.client
            .setup(Elf::Static(elf))
            .map_err(|error| error.to_string())
    }

    fn prove(
        &self,
        program: &SP1ProvingKey,
        stdin: SP1Stdin,
    ) -> Result<SP1ProofWithPublicValues, String> {
        self.client
            .prove(program, stdin)
            .compressed()
            .run()
            .map_err(|error| error.to_string())
    }
}
