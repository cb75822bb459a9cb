//! Cheats about words: what is stated has one encoding, and nothing is left over.

use super::lies::World;
use bytemuck::TransparentWrapper;
use zk0_argument::field::goldilocks::P;
use zk0_argument::field::Goldilocks;
use zk0_argument::hash::SpongeDigest;
use zk0_argument::transcript::{Pads, Prover, Refused, Verifier};
use zk0_argument::tree::prove::Tree;
use zk0_argument::tree::{open, receive_cap};

#[test]
fn words_after_the_end_are_refused() {
    let told = World::random(1, 51).changed(|proof| proof.push(0));
    assert_eq!(told, Err(Refused::Length("more")));
}

#[test]
fn an_argument_that_ends_early_is_refused() {
    let told = World::random(1, 52).changed(|proof| proof.truncate(proof.len() - 1));
    assert_eq!(told, Err(Refused::Length("fewer")));
}

const STATEMENT: SpongeDigest = SpongeDigest([3, 1, 4, 1]);

/// A tree of two rows, of which the first is opened, and what a verifier states of it.
fn opened(row: [u64; 4], change: impl FnOnce(&mut Vec<u64>)) -> Result<(), Refused> {
    let mut prover = Prover::new(&STATEMENT, Pads::new(vec![]));
    let tree = Tree::new(2, 4, 0, |_, column| row[column]);
    tree.send_cap(&mut prover);
    tree.open(&mut prover, Goldilocks::wrap_slice(&row), 0);
    let mut proof = prover.finish()?;
    change(&mut proof);
    let mut verifier = Verifier::new(&STATEMENT, &proof);
    let cap = receive_cap(&mut verifier, 0)?;
    open(&mut verifier, &cap, 1, 0, &[2], 2)?;
    verifier.finish()
}

/// A row has p in place of zero. The element is the same, but another word is hashed: if both were accepted, a node could have one sample in its
/// dataset twice, with two leaves.
#[test]
fn a_second_encoding_of_a_row_is_refused() {
    assert_eq!(opened([7, 0, 5, 6], |_| ()), Ok(()));
    let place = 4 + 1;
    let told = opened([7, P, 5, 6], |proof| assert_eq!(proof[place], P));
    assert_eq!(told, Err(Refused::NotCanonical(place)));
}

/// The permutation calculates modulo the prime of KoalaBear, so that a digest would have several encodings, and a proof as well.
#[test]
fn a_second_encoding_of_a_digest_is_refused() {
    const KOALA_BEAR: u64 = 0x7f00_0001;
    let place = 4 + 4;
    let told = opened([7, 0, 5, 6], |proof| proof[place] += KOALA_BEAR);
    assert_eq!(told, Err(Refused::NotCanonical(place)));
}
