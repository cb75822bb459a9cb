//! The readers under test.

use crate::allocations::peak;

/// A reader under test.
pub struct Target {
    /// Valid inputs, which fuzzing starts from.
    pub seeds: Vec<Vec<u8>>,
    /// Reads an input, or says why it does not.
    pub run: Box<dyn FnMut(&[u8]) -> Result<(), String>>,
}

/// The readers of a crate.
pub struct Targets {
    /// What they are called. The folders of their inputs have the same names.
    pub names: &'static [&'static str],
    /// Makes the target of a name.
    pub target: fn(&str) -> Target,
    /// What any input may make a reader allocate at once, in bytes.
    pub slack: usize,
}

impl Targets {
    /// Whether the target reads the input, or why not. `Err` if it allocates too much.
    pub(super) fn run(
        &self,
        target: &mut Target,
        input: &[u8],
    ) -> Result<Result<(), String>, String> {
        let (outcome, bytes) = peak(|| (target.run)(input));
        let length = input.len();
        if bytes > self.slack + 64 * length {
            return Err(format!("{bytes} bytes allocated for {length} of input"));
        }
        Ok(outcome)
    }
}
