//! Checks an argument as the guest program does: `check_argument INPUT`, such as `tests/fixtures/full_size/input.bin`. It needs neither samples nor
//! weights. Prints the claim.

use std::error::Error;
use std::{env, fs};
use zk0_argument::claim::{check, ClaimInput};

fn main() -> Result<(), Box<dyn Error>> {
    let input = env::args().nth(1).ok_or("usage: check_argument INPUT")?;
    let buffers: Vec<Vec<u8>> = borsh::from_slice(&fs::read(input)?)?;
    let (claim, _) = check(&ClaimInput::from_buffers(&buffers)?)?;
    println!("the argument holds: {claim:#?}");
    Ok(())
}
