//! The prototype's verifier as an SP1 program: reads a statement and a proof, commits to the digest of what is left to
//! show, or panics.
#![no_main]

use zk0_succinct::{field::F, program::Statement};

sp1_zkvm::entrypoint!(main);

fn main() {
    let statement = sp1_zkvm::io::read_vec();
    let proof = sp1_zkvm::io::read_vec();
    let words: Vec<u32> = statement.chunks_exact(4).map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect();
    // SAFETY: F is a u32, for which any bits will do.
    let (before, proof, after) = unsafe { proof.align_to::<F>() };
    assert!(before.is_empty() && after.is_empty(), "the proof is not a list of aligned words");
    let statement = Statement::from_words(&words).unwrap_or_else(|refused| panic!("{refused}"));
    let digest = statement.verify(proof).unwrap_or_else(|refused| panic!("{refused}"));
    for value in digest {
        sp1_zkvm::io::commit_slice(&value.0.to_le_bytes());
    }
}
