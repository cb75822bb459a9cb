//! The SP1 program of mode `checked`: matrix products are hinted, and checked with random coefficients.
#![no_main]

use zk0_circuits::{budget::operation, hinted::HintedWitness, statement};

sp1_zkvm::entrypoint!(main);

/// Reads a witness and commits the claim it proves; panics, so that no proof exists, when it proves none.
fn main() {
    let decoding = operation("hint decoding");
    // The number of hint buffers follows from the number of samples, which the first buffer tells.
    let mut buffers: Vec<Vec<u8>> = vec![sp1_zkvm::io::read_vec()];
    let count = HintedWitness::buffers(&buffers[0]).unwrap_or_else(|error| panic!("{error}"));
    buffers.extend((1..count).map(|_| sp1_zkvm::io::read_vec()));
    let witness = HintedWitness::from_buffers(&buffers).unwrap_or_else(|error| panic!("{error}"));
    decoding.end();
    let claim = statement::check_hinted(&witness).unwrap_or_else(|error| panic!("{error}"));
    let public_values = borsh::to_vec(&claim).unwrap_or_else(|error| panic!("{error}"));
    sp1_zkvm::io::commit_slice(&public_values);
}
