//! Readers under test.

use crate::allocations::peak;

/// A reader under test.
pub struct Target {
    /// Valid inputs to start from.
    pub seeds: Vec<Vec<u8>>,
    /// Reads an input, or explains why not.
    pub run: Box<dyn FnMut(&[u8]) -> Result<(), String>>,
}

/// The readers of a crate.
pub struct Targets {
    /// Names of targets and their folders.
    pub names: &'static [&'static str],
    /// The target of this name.
    pub target: fn(&str) -> Target,
    /// Bytes that any input may make a reader allocate at once.
    pub slack: usize,
}

impl Targets {
    /// `Err` if the target allocates too much.
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
