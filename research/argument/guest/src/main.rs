//! The argument's verifier as an SP1 program: reads a statement and a proof, and publishes the digest of the statement, the digest of what
//! is left to check, and the losses, or panics.
#![no_main]

use zk0_argument::expert::argument::verify_with_digest;
use zk0_argument::expert::encoding;
use zk0_argument::expert::statement::Statement;
use zk0_argument::operation;

sp1_zkvm::entrypoint!(main);

/// A list of words, as the prover gives them.
fn words(bytes: &[u8]) -> &[u64] {
    // SAFETY: any bits are a u64.
    let (before, words, after) = unsafe { bytes.align_to() };
    assert!(before.is_empty() && after.is_empty(), "an input is not a list of aligned words");
    words
}

fn main() {
    let encoding = sp1_zkvm::io::read_vec();
    let proof = sp1_zkvm::io::read_vec();
    let decoding = operation("statement");
    // A statement has one encoding: the digest of these words is that of the statement.
    let digest = encoding::digest(words(&encoding));
    let statement = Statement::decode(words(&encoding)).unwrap_or_else(|error| panic!("{error}"));
    decoding.end();
    let published = verify_with_digest(&statement, &digest, words(&proof));
    let published = published.unwrap_or_else(|refused| panic!("{refused}"));
    let digesting = operation("published claims");
    let digests = [digest, published.digest()];
    digesting.end();
    for word in digests.iter().flat_map(|digest| digest.0) {
        sp1_zkvm::io::commit_slice(&word.to_le_bytes());
    }
    for loss in statement.samples.iter().flat_map(|sample| sample.losses) {
        sp1_zkvm::io::commit_slice(&loss.to_le_bytes());
    }
}
