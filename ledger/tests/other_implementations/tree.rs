//! The proofs that a ledger hands out, verified by another implementation of RFC 6962.

use crate::network::*;
use ct_merkle::mem_backed_tree::MemoryBackedTree;
use ct_merkle::{ConsistencyProof, InclusionProof};
use sha2_11::Sha256;
use zk0_circuits::Digest;
use zk0_ledger::Ledger;

/// The other implementation's root over the first `size` leaves.
fn oracle(leaves: &[Vec<u8>]) -> MemoryBackedTree<Sha256, Vec<u8>> {
    let mut tree = MemoryBackedTree::new();
    leaves.iter().cloned().for_each(|leaf| tree.push(leaf));
    tree
}

fn concat(proof: &[Digest]) -> Vec<u8> {
    proof.iter().flat_map(|digest| digest.0).collect()
}

#[test]
fn another_implementation_verifies_the_proofs() {
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
        let proof = concat(&ledger.consistency_between(size, ledger.size()).unwrap());
        let proof = ConsistencyProof::<Sha256>::try_from_bytes(proof).unwrap();
        theirs
            .root()
            .verify_consistency(&old.root(), &proof)
            .unwrap();
    }
}
