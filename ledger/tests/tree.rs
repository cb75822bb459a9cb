//! Our tree against another implementation of RFC 6962.

mod network;

use ct_merkle::{mem_backed_tree::MemoryBackedTree, ConsistencyProof, InclusionProof};
use network::*;
use proptest::prelude::*;
use sha2_11::Sha256;
use zk0_circuits::Digest;
use zk0_ledger::Ledger;
use zk0_protocol::tlog::tree::Frontier;

/// The other implementation's root over the first `size` leaves.
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
fn proofs_convince_another_implementation() {
    let dir = tempfile::tempdir().unwrap();
    let (mut ledger, _) = Ledger::create(dir.path(), genesis(), log_key(), T0).unwrap();
    for node in 0..20 {
        ledger.append(T0, enrolled(node)).unwrap();
    }
    let leaves: Vec<Vec<u8>> = (0..ledger.size())
        .map(|index| ledger.entry(index).unwrap().encode().unwrap())
        .collect();
    let theirs = oracle(&leaves);
    for index in 0..ledger.size() {
        let receipt = ledger.receipt(index).unwrap();
        let (checkpoint, entry) = receipt.verify(&genesis().log_key, &genesis().name).unwrap();
        assert_eq!(entry.encode().unwrap(), leaves[index as usize]);
        assert_eq!(&checkpoint.root.0[..], &theirs.root().as_bytes()[..]);
        let proof = InclusionProof::<Sha256>::try_from_bytes(concat(&receipt.proof)).unwrap();
        theirs
            .root()
            .verify_inclusion(&leaves[index as usize], index, &proof)
            .unwrap();
    }
    for size in 1..=ledger.size() {
        let old = oracle(&leaves[..size as usize]);
        let proof = concat(&ledger.consistency(size).unwrap());
        let proof = ConsistencyProof::<Sha256>::try_from_bytes(proof).unwrap();
        theirs
            .root()
            .verify_consistency(&old.root(), &proof)
            .unwrap();
    }
}

#[test]
fn a_receipt_changed_anywhere_proves_nothing() {
    let dir = tempfile::tempdir().unwrap();
    let (mut ledger, _) = Ledger::create(dir.path(), genesis(), log_key(), T0).unwrap();
    for node in 0..5 {
        ledger.append(T0, enrolled(node)).unwrap();
    }
    let receipt = ledger.receipt(2).unwrap();
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
