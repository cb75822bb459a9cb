//! The SP1 program of mode `checked`: the prover hints the matrix products, and this program checks them with random coefficients.
#![no_main]

use zk0_circuits::claim::hinted_input::HintedInput;
use zk0_circuits::claim::statement;
use zk0_circuits::vm::budget::operation;

sp1_zkvm::entrypoint!(main);

/// Reads the private input and commits the claim that it proves. Panics where a check fails, so that there is no proof.
fn main() {
    let decoding = operation("hint decoding");
    // The first buffer tells the number of samples, and the number of hint buffers follows from it.
    let mut buffers: Vec<Vec<u8>> = vec![sp1_zkvm::io::read_vec()];
    let count = HintedInput::buffers(&buffers[0]).unwrap_or_else(|error| panic!("{error}"));
    buffers.extend((1..count).map(|_| sp1_zkvm::io::read_vec()));
    let input = HintedInput::from_buffers(&buffers).unwrap_or_else(|error| panic!("{error}"));
    decoding.end();
    let claim = statement::check_hinted(&input).unwrap_or_else(|error| panic!("{error}"));
    let public_values = borsh::to_vec(&claim).unwrap_or_else(|error| panic!("{error}"));
    sp1_zkvm::io::commit_slice(&public_values);
}
