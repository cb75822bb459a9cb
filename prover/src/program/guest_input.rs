//! What a guest program reads, and the claim that follows from it.

use zk0_circuits::claim::hinted_input::HintedInput;
use zk0_circuits::claim::private_input::InputError;
use zk0_circuits::claim::statement::{check, check_hinted};
use zk0_circuits::claim::statement_error::StatementError;
use zk0_circuits::{Claim, Mode, PrivateInput};

/// A private input as the program of a mode reads it. It holds samples and the dataset's salt, so it must stay private.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct GuestInput {
    /// The program that reads it.
    pub mode: Mode,
    /// One buffer for each read.
    pub buffers: Vec<Vec<u8>>,
}

/// Why an input proves no claim.
#[derive(Debug, thiserror::Error)]
pub enum GuestInputError {
    /// The buffers do not have the form that the program reads.
    #[error("the private input cannot be read: {0}")]
    Unreadable(#[from] InputError),
    /// The statement is false.
    #[error("the claim does not hold: {0}")]
    Statement(#[from] StatementError),
}

impl GuestInput {
    /// The claim that `input` proves, and the buffers that the program reads. In mode `checked`, this computes the matrix products
    /// that the program only checks.
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

    /// The bytes of all buffers.
    pub fn bytes(&self) -> u64 {
        self.buffers.iter().map(|buffer| buffer.len() as u64).sum()
    }

    /// The claim. It is found by running natively what the program runs; the error says why there is no claim.
    pub fn claim(&self) -> Result<Claim, GuestInputError> {
        Ok(match self.mode {
            Mode::Direct => check(&PrivateInput::from_buffers(&self.buffers)?)?,
            Mode::Checked => check_hinted(&HintedInput::from_buffers(&self.buffers)?)?,
        })
    }
}
