//! The SP1 program of mode `direct`: it computes everything that the claim states, matrix products included.
#![no_main]

use zk0_circuits::claim::private_input::INPUT_BUFFERS;
use zk0_circuits::claim::statement;
use zk0_circuits::PrivateInput;

sp1_zkvm::entrypoint!(main);

/// Reads the private input and commits the claim that it proves. Panics where a check fails, so that there is no proof.
fn main() {
    let buffers: [Vec<u8>; INPUT_BUFFERS] = std::array::from_fn(|_| sp1_zkvm::io::read_vec());
    let input = PrivateInput::from_buffers(&buffers).unwrap_or_else(|error| panic!("{error}"));
    let claim = statement::check(&input).unwrap_or_else(|error| panic!("{error}"));
    let public_values = borsh::to_vec(&claim).unwrap_or_else(|error| panic!("{error}"));
    sp1_zkvm::io::commit_slice(&public_values);
}
