//! The guest programs, and what they read. The programs' verifying keys, which are all that a verifier needs, are in
//! [`zk0_circuits::claim::program`].

use zk0_circuits::{
    claim::{
        hinted_input::HintedInput,
        private_input::InputError,
        statement::{check, check_hinted},
        statement_error::StatementError,
    },
    Claim, Mode, PrivateInput,
};

/// The ELF of the program of `mode`, as `circuits/build-guest.sh` builds it.
pub fn elf(mode: Mode) -> &'static [u8] {
    match mode {
        Mode::Direct => include_bytes!("../../circuits/elf/direct.elf"),
        Mode::Checked => include_bytes!("../../circuits/elf/checked.elf"),
    }
}

/// A private input as the program of a mode reads it. Private: it holds samples and the dataset's salt.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct GuestInput {
    /// Which program.
    pub mode: Mode,
    /// One per read.
    pub buffers: Vec<Vec<u8>>,
}

/// Why there is no claim for an input.
#[derive(Debug, thiserror::Error)]
pub enum GuestInputError {
    /// The buffers do not hold a private input.
    #[error("the input cannot be read: {0}")]
    Unreadable(#[from] InputError),
    /// The statement is false.
    #[error("the claim does not hold: {0}")]
    Statement(#[from] StatementError),
}

impl GuestInput {
    /// The claim that `input` proves, and the input for it: in mode `checked`, the products are computed here.
    pub fn of(mode: Mode, input: &PrivateInput) -> Result<(Claim, Self), StatementError> {
        let (claim, buffers) = match mode {
            Mode::Direct => (check(input)?, input.to_buffers().to_vec()),
            Mode::Checked => {
                let hinted = HintedInput::of(input)?;
                (check_hinted(&hinted)?, hinted.to_buffers())
            }
        };
        Ok((claim, Self { mode, buffers }))
    }

    /// The claim, by running natively what the program runs; says why there is none.
    pub fn claim(&self) -> Result<Claim, GuestInputError> {
        Ok(match self.mode {
            Mode::Direct => check(&PrivateInput::from_buffers(&self.buffers)?)?,
            Mode::Checked => check_hinted(&HintedInput::from_buffers(&self.buffers)?)?,
        })
    }
}
