//! Which private inputs may leave this machine.

use super::guest_input::GuestInput;
use zk0_circuits::Mode;

/// A private input that may go to another party's machine, without recording or weights. What it still shows: docs/prove.md, "What leaves
/// the machine?".
#[derive(Clone, Copy, Debug)]
pub struct Shareable<'a>(&'a GuestInput);

/// The private input holds data that must stay on this machine.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "a private input of mode {0} holds samples of the recording, so it must not go to a prover network: have this claim proven with \
     --device cpu or --device cuda; only claims of mode succinct can be proven by others"
)]
pub struct HoldsRecording(pub Mode);

impl<'a> Shareable<'a> {
    /// Allows inputs of mode `succinct`.
    pub fn of(input: &'a GuestInput) -> Result<Self, HoldsRecording> {
        match input.mode {
            Mode::Succinct => Ok(Self(input)),
            mode => Err(HoldsRecording(mode)),
        }
    }

    /// The input to send.
    pub fn input(self) -> &'a GuestInput {
        self.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_input_that_holds_a_recording_is_never_shareable() {
        for mode in Mode::ALL {
            let buffers = vec![vec![1]];
            let shareable = Shareable::of(&GuestInput::new(mode, buffers)).map(|_| ());
            let expected = match mode {
                Mode::Succinct => Ok(()),
                _ => Err(HoldsRecording(mode)),
            };
            assert_eq!(shareable, expected);
        }
    }
}
