//! Compares our tree with another implementation of RFC 6962.

use ct_merkle::mem_backed_tree::MemoryBackedTree;
use ct_merkle::{ConsistencyProof, InclusionProof};
use proptest::prelude::*;
use sha2_11::Sha256;
use zk0_circuits::Digest;
use zk0_protocol::tlog::tree::Frontier;
use zk0_testkit::network::log::*;
use zk0_testkit::network::*;

/// Returns the other implementation's root over the first `size` leaves.
fn oracle(leaves: &[Vec<u8>]) -> MemoryBackedTree<Sha256, Vec<u8>> {
    let mut tree = MemoryBackedTree::new();
    leaves.iter().cloned().for_each(|leaf| tree.push(leaf));
    tree
}

fn concat(proof: &[Digest]) -> Vec<u8> {
    proof.iter().flat_map(|digest| digest.0).collect()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn roots_are_those_of_another_implementation(
        leaves in prop::collection::vec(prop::collection::vec(any::<u8>(), 0..40), 1..300),
    ) {
        let mut ours = Frontier::default();
        let mut theirs = MemoryBackedTree::<Sha256, Vec<u8>>::new();
        for leaf in leaves {
            ours.push(&leaf).unwrap();
            theirs.push(leaf);
            prop_assert_eq!(ours.root().unwrap().0.to_vec(), theirs.root().as_bytes().to_vec());
            prop_assert_eq!(ours.size(), theirs.len());
        }
    }
}

#[test]
fn another_implementation_verifies_our_proofs() {
    let leaves: Vec<Vec<u8>> = (0..21u8).map(|leaf| vec![leaf; 40]).collect();
    let log = MemoryLog::of(&leaves);
    let theirs = oracle(&leaves);
    for (index, leaf) in (0u64..).zip(&leaves) {
        let proof = concat(&log.receipt(index).proof);
        let proof = InclusionProof::<Sha256>::try_from_bytes(proof).unwrap();
        let verified = theirs.root().verify_inclusion(leaf, index, &proof);
        verified.unwrap();
    }
    for size in 1..=leaves.len() {
        let old = oracle(&leaves[..size]);
        let proof = concat(&log.consistency(size as u64, leaves.len() as u64));
        let proof = ConsistencyProof::<Sha256>::try_from_bytes(proof).unwrap();
        let verified = theirs.root().verify_consistency(&old.root(), &proof);
        verified.unwrap();
    }
}

#[test]
fn a_receipt_changed_anywhere_is_refused() {
    let receipt = MemoryLog::of_enrolments(5, 0).receipt(2);
    let verify =
        |receipt: &zk0_protocol::Receipt| receipt.verify(&genesis().log_key, &genesis().name);
    verify(&receipt).unwrap();
    let bytes = borsh::to_vec(&receipt).unwrap();
    for position in 0..bytes.len() {
        let mut changed = bytes.clone();
        changed[position] ^= 1;
        let accepted = borsh::from_slice(&changed).is_ok_and(|receipt| verify(&receipt).is_ok());
        assert!(!accepted, "byte {position} of the receipt does not matter");
    }
    let mut longer = receipt.clone();
    longer.proof.push(digest(0));
    assert!(verify(&longer).is_err());
    assert!(receipt
        .verify(&genesis().log_key, "another.origin")
        .is_err());
    let other_key = key(1).verifying_key().to_bytes();
    assert!(receipt.verify(&other_key, &genesis().name).is_err());
}
