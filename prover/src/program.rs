//! The guest programs, and what they read. The programs' verifying keys, which are all that a verifier needs, are in
//! [`zk0_circuits::program`].

use zk0_circuits::{
    hinted::HintedWitness,
    statement::{check, check_hinted, Mode, StatementError},
    witness::WitnessError,
    Claim, Witness,
};

/// The ELF of the program of `mode`, as `circuits/build-guest.sh` builds it.
pub fn elf(mode: Mode) -> &'static [u8] {
    match mode {
        Mode::Direct => include_bytes!("../../circuits/elf/direct.elf"),
        Mode::Checked => include_bytes!("../../circuits/elf/checked.elf"),
    }
}

/// A witness as the program of a mode reads it. Private: it holds samples and the dataset's salt.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct GuestInput {
    /// Which program.
    pub mode: Mode,
    /// One per read.
    pub buffers: Vec<Vec<u8>>,
}

/// Why an input is of no claim.
#[derive(Debug, thiserror::Error)]
pub enum InputError {
    /// The buffers are no witness.
    #[error("the witness cannot be read: {0}")]
    Unreadable(#[from] WitnessError),
    /// The statement is false.
    #[error("the claim does not hold: {0}")]
    Statement(#[from] StatementError),
}

impl GuestInput {
    /// The claim that `witness` proves, and the input for it: in mode `checked`, the products are computed here.
    pub fn of(mode: Mode, witness: &Witness) -> Result<(Claim, Self), StatementError> {
        let (claim, buffers) = match mode {
            Mode::Direct => (check(witness)?, witness.to_buffers().to_vec()),
            Mode::Checked => {
                let hinted = HintedWitness::of(witness)?;
                (check_hinted(&hinted)?, hinted.to_buffers())
            }
        };
        Ok((claim, Self { mode, buffers }))
    }

    /// The claim, by running natively what the program runs; says why there is none.
    pub fn claim(&self) -> Result<Claim, InputError> {
        Ok(match self.mode {
            Mode::Direct => check(&Witness::from_buffers(&self.buffers)?)?,
            Mode::Checked => check_hinted(&HintedWitness::from_buffers(&self.buffers)?)?,
        })
    }
}
