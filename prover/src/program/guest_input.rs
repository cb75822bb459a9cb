//! What a guest program reads, and the claim that follows from it.

use borsh::{BorshDeserialize, BorshSerialize};
use std::path::Path;
use zk0_argument::claim::{self, Blind, ClaimInput, ClaimSource, NotMade, NotShown};
use zk0_argument::expert::prover_values::Unprovable;
use zk0_circuits::claim::private_input::InputError;
use zk0_circuits::claim::statement::check;
use zk0_circuits::claim::statement_error::StatementError;
use zk0_circuits::{Claim, Mode, PrivateInput};

/// An input as the program of a mode reads it. In mode `direct` it holds samples and weights, and in both modes the dataset's salt, so it
/// must stay private.
#[derive(Clone, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct GuestInput {
    /// The program that reads it.
    pub mode: Mode,
    /// One buffer for each read.
    pub buffers: Vec<Vec<u8>>,
}

/// A claim that is ready to be proven.
#[derive(Clone, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct PreparedClaim {
    /// The claim.
    pub claim: Claim,
    /// What [`Claim::weight_check`] is the digest of. It travels with the proof. Nothing in mode `direct`.
    pub weight_check: Vec<u8>,
    /// What the guest program reads.
    pub input: GuestInput,
}

/// Why a claim cannot be proven.
#[derive(Debug, PartialEq, thiserror::Error)]
pub enum NotProvable {
    /// It does not hold.
    #[error(transparent)]
    Statement(#[from] StatementError),
    /// A sample cannot be read.
    #[error("a sample of the claim cannot be read: {0}")]
    Sample(String),
    /// There is no argument for it, in mode `succinct`.
    #[error(transparent)]
    Argument(NotMade),
    /// The argument that was made does not verify.
    #[error("the argument was made, but it does not verify: {0}")]
    Unsound(NotShown),
}

impl NotProvable {
    /// Whether the claim may be provable all the same: a file could not be read or written, for example because the disk is full.
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
    /// The buffers do not have the form that the program reads.
    #[error("the private input cannot be read: {0}")]
    Unreadable(#[from] InputError),
    /// The statement is false.
    #[error("the claim does not hold: {0}")]
    Statement(#[from] StatementError),
    /// The same, in mode `succinct`.
    #[error("the claim does not hold: {0}")]
    NotShown(#[from] NotShown),
}

impl PreparedClaim {
    /// The claim that `source` proves, and what the program reads. `blind` hides the samples. In mode `succinct`, this makes the argument that the program verifies; with a
    /// folder, values of samples are in files there meanwhile, and `progress` is told which share of the work is done, from 0 to 1. At the published
    /// size this takes minutes for each sample.
    ///
    /// # Errors
    /// The claim does not hold, or cannot be proven in this mode.
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
        let input = GuestInput { mode, buffers };
        Ok(Self {
            claim,
            weight_check,
            input,
        })
    }
}

impl GuestInput {
    /// The bytes of all buffers.
    pub fn bytes(&self) -> u64 {
        self.buffers.iter().map(|buffer| buffer.len() as u64).sum()
    }

    /// The claim. It is found by running natively what the program runs; the error says why there is no claim.
    pub fn claim(&self) -> Result<Claim, GuestInputError> {
        Ok(match self.mode {
            Mode::Direct => check(&PrivateInput::from_buffers(&self.buffers)?)?,
            Mode::Succinct => claim::check(&ClaimInput::from_buffers(&self.buffers)?)?.0,
        })
    }
}
