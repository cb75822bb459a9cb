//! What a reader may do with an input: neither panic, nor allocate out of proportion. `corpus` gives it the inputs that are kept,
//! `guided` those that libFuzzer makes up.

#![allow(unexpected_cfgs)] // `scripts/fuzz` sets `fuzzing`

mod corpus;
#[cfg(fuzzing)]
mod guided;

use crate::allocations::peak;

// Each test has its own `targets`.
use crate::targets::{Target, SLACK};

pub use corpus::read_again;

/// What an input may make the reader allocate at once.
pub fn allowed(input: &[u8]) -> usize {
    SLACK + 64 * input.len()
}

/// Whether the target reads the input, or why not. `Err` if it allocates too much.
pub fn run(target: &mut Target, input: &[u8]) -> Result<Result<(), String>, String> {
    let (outcome, bytes) = peak(|| (target.run)(input));
    let length = input.len();
    if bytes > allowed(input) {
        return Err(format!("{bytes} bytes allocated for {length} of input"));
    }
    Ok(outcome)
}
