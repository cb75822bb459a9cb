//! A guest program's input, and the claim it proves.

use borsh::{BorshDeserialize, BorshSerialize};
use std::path::Path;
use zk0_argument::claim::{self, Blind, ClaimInput, ClaimSource, NotMade, NotShown};
use zk0_argument::expert::prover_values::Unprovable;
use zk0_circuits::claim::private_input::InputError;
use zk0_circuits::claim::program::verifying_key;
use zk0_circuits::claim::statement::check;
use zk0_circuits::claim::statement_error::StatementError;
use zk0_circuits::{Claim, Mode, PrivateInput};

/// A program's input. It must stay private: in mode `direct` it holds samples and weights, and in both modes the dataset's salt.
#[derive(Clone, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct GuestInput {
    /// The program's mode.
    pub mode: Mode,
    /// The program's verifying key.
    pub program: Vec<u8>,
    /// One buffer per read.
    pub buffers: Vec<Vec<u8>>,
}

/// A claim ready to prove.
#[derive(Clone, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct PreparedClaim {
    /// The claim.
    pub claim: Claim,
    /// The preimage of [`Claim::weight_check`], which travels with the proof. Empty in mode `direct`.
    pub weight_check: Vec<u8>,
    /// The guest program's input.
    pub input: GuestInput,
}

/// Why a claim cannot be proven.
#[derive(Debug, PartialEq, thiserror::Error)]
pub enum NotProvable {
    /// The claim does not hold.
    #[error(transparent)]
    Statement(#[from] StatementError),
    /// A sample is unreadable.
    #[error("a sample of the claim cannot be read: {0}")]
    Sample(String),
    /// Mode `succinct` could not make the argument.
    #[error(transparent)]
    Argument(NotMade),
    /// The argument does not verify.
    #[error("the argument was made, but it does not verify: {0}")]
    Unsound(NotShown),
}

impl NotProvable {
    /// Whether a retry may succeed: a file could not be read or written, perhaps because the disk is full.
    pub fn may_pass(&self) -> bool {
        matches!(
            self,
            Self::Sample(_)
                | Self::Argument(NotMade::Unprovable(
                    Unprovable::File(_) | Unprovable::Sample { .. }
                ))
        )
    }
}

impl From<NotMade> for NotProvable {
    fn from(error: NotMade) -> Self {
        match error {
            NotMade::Statement(error) => Self::Statement(error),
            error => Self::Argument(error),
        }
    }
}

/// Why an input proves no claim.
#[derive(Debug, thiserror::Error)]
pub enum GuestInputError {
    /// The program cannot read the buffers.
    #[error("the private input cannot be read: {0}")]
    Unreadable(#[from] InputError),
    /// The statement is false.
    #[error("the claim does not hold: {0}")]
    Statement(#[from] StatementError),
    /// The statement is false, in mode `succinct`.
    #[error("the claim does not hold: {0}")]
    NotShown(#[from] NotShown),
}

impl PreparedClaim {
    /// The claim that `source` proves, and the input of this release's own program. `blind` hides the samples. Mode `succinct` makes the
    /// argument, in minutes per sample at the published size. With a folder, values of samples are in files there meanwhile. `progress`
    /// gets the share done, from 0 to 1.
    ///
    /// # Errors
    /// The claim does not hold, or this mode cannot prove it.
    pub fn of(
        mode: Mode,
        source: &impl ClaimSource,
        blind: &Blind,
        folder: Option<&Path>,
        progress: &mut dyn FnMut(f64),
    ) -> Result<Self, NotProvable> {
        let (claim, weight_check, buffers) = match mode {
            Mode::Direct => {
                let input = source.whole();
                let input = input.map_err(|error| NotProvable::Sample(error.to_string()))?;
                (check(&input)?, vec![], input.to_buffers().to_vec())
            }
            Mode::Succinct => {
                let made = claim::make(source, blind, folder, progress)?;
                let (claim, left) = claim::check(&made).map_err(|error| match error {
                    NotShown::Statement(error) => NotProvable::Statement(error),
                    error => NotProvable::Unsound(error),
                })?;
                let words = left.words();
                let weight_check = words.iter().flat_map(|word| word.to_le_bytes());
                (claim, weight_check.collect(), made.to_buffers().to_vec())
            }
        };
        let input = GuestInput::new(mode, buffers);
        Ok(Self {
            claim,
            weight_check,
            input,
        })
    }
}

impl GuestInput {
    /// The input of this release's own program of `mode`.
    pub fn new(mode: Mode, buffers: Vec<Vec<u8>>) -> Self {
        Self {
            mode,
            program: verifying_key(mode).to_vec(),
            buffers,
        }
    }

    /// The bytes of all buffers.
    pub fn bytes(&self) -> u64 {
        self.buffers.iter().map(|buffer| buffer.len() as u64).sum()
    }

    /// The claim, from a native run of the program's checks.
    pub fn claim(&self) -> Result<Claim, GuestInputError> {
        Ok(match self.mode {
            Mode::Direct => check(&PrivateInput::from_buffers(&self.buffers)?)?,
            Mode::Succinct => claim::check(&ClaimInput::from_buffers(&self.buffers)?)?.0,
        })
    }
}
