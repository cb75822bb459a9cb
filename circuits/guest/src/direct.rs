//! The SP1 program of mode `direct`: everything the claim says is computed here, matrix products included.
#![no_main]

use zk0_circuits::{statement, witness::WITNESS_BUFFERS, Witness};

sp1_zkvm::entrypoint!(main);

/// Reads a witness and commits the claim it proves; panics, so that no proof exists, when it proves none.
fn main() {
    let buffers: [Vec<u8>; WITNESS_BUFFERS] = std::array::from_fn(|_| sp1_zkvm::io::read_vec());
    let witness = Witness::from_buffers(&buffers).unwrap_or_else(|error| panic!("{error}"));
    let claim = statement::check(&witness).unwrap_or_else(|error| panic!("{error}"));
    let public_values = borsh::to_vec(&claim).unwrap_or_else(|error| panic!("{error}"));
    sp1_zkvm::io::commit_slice(&public_values);
}
