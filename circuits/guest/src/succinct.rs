//! The SP1 program of mode `succinct`: it verifies an argument, which was made natively, that both evaluations are right.
#![no_main]

use zk0_argument::claim::{check, ClaimInput, CLAIM_BUFFERS};
use zk0_argument::operation;

sp1_zkvm::entrypoint!(main);

/// Reads the input and commits the claim that it proves. Panics where a check fails, so that there is no proof.
fn main() {
    let decoding = operation("input decoding");
    let buffers: [Vec<u8>; CLAIM_BUFFERS] = std::array::from_fn(|_| sp1_zkvm::io::read_vec());
    let input = ClaimInput::from_buffers(&buffers).unwrap_or_else(|error| panic!("{error}"));
    decoding.end();
    let (claim, _) = check(&input).unwrap_or_else(|error| panic!("{error}"));
    let public_values = borsh::to_vec(&claim).unwrap_or_else(|error| panic!("{error}"));
    sp1_zkvm::io::commit_slice(&public_values);
}
