//! Bytes that are no proof of this network are refused, each for its own reason, and none makes the verifier panic or
//! allocate what the bytes cannot hold.

use proptest::prelude::*;
use sp1_hypercube::{create_dummy_recursion_proof, SP1VerifyingKey};
use sp1_verifier::{Groth16Bn254Proof, PlonkBn254Proof, SP1Proof};
use zk0_circuits::claim::student::Confidence;
use zk0_circuits::claim::t_test::TTest;
use zk0_circuits::{
    Claim, DatasetCommitment, Digest, Losses, NodeId, Terms, WeightsDigest, CLAIM_VERSION,
};
use zk0_protocol::{Refusal, RefusalCode};
use zk0_verifier::{check_proof, ProgramKey};

fn claim() -> Claim {
    let weights = WeightsDigest {
        blob: Digest([1; 32]),
        quantised: Digest([2; 32]),
    };
    Claim {
        version: CLAIM_VERSION,
        terms: Terms {
            network: Digest([3; 32]),
            round: 0,
            node: NodeId([4; 32]),
            dataset: DatasetCommitment {
                root: Digest([5; 32]),
                samples: 100,
                feature_spec: Digest([6; 32]),
                salt_commitment: Digest([7; 32]),
            },
            evaluation: Digest([8; 32]),
            base: weights,
            update: weights,
            challenge: Digest([9; 32]),
            eval_samples: 4,
            test: TTest {
                min_improvement_bps: 100,
                confidence: Confidence::P95,
            },
        },
        losses: Losses::Hidden,
        weight_check: None,
    }
}

fn check(proof: &[u8]) -> Refusal {
    let key = ProgramKey::from_bytes(&[0; 32]).unwrap();
    check_proof(proof, &claim(), &key).unwrap_err()
}

fn malformed(proof: &[u8], cause: &str) {
    let refusal = check(proof);
    assert_eq!(refusal.code, RefusalCode::MalformedProof, "{refusal}");
    assert!(refusal.detail.contains(cause), "{refusal}");
}

fn encode(proof: &SP1Proof) -> Vec<u8> {
    bincode::serialize(proof).unwrap()
}

/// Returns what SP1's mock prover makes for a program. Its structures are valid, but it proves nothing.
fn mock_proof() -> Vec<u8> {
    let key: SP1VerifyingKey = bincode::deserialize(&[0; 4096]).unwrap();
    encode(&SP1Proof::Compressed(Box::new(
        create_dummy_recursion_proof(&key),
    )))
}

#[test]
fn other_kinds_of_proof_are_refused() {
    malformed(b"", "too few");
    malformed(&[1, 0, 0], "too few");
    malformed(&[9; 100], "unknown kind");
    malformed(&encode(&SP1Proof::Core(Vec::new())), "core");
    malformed(
        &encode(&SP1Proof::Plonk(PlonkBn254Proof::default())),
        "PLONK",
    );
    malformed(
        &encode(&SP1Proof::Groth16(Groth16Bn254Proof::default())),
        "Groth16",
    );
}

#[test]
fn a_mock_proof_is_refused() {
    assert_eq!(check(&mock_proof()).code, RefusalCode::InvalidProof);
}

#[test]
fn bytes_after_a_proof_are_refused() {
    malformed(&[&mock_proof()[..], &[0]].concat(), "");
}

#[test]
fn a_second_encoding_of_the_same_proof_is_refused() {
    let mut proof = mock_proof();
    // The first element of the verifying key follows the kind. Zero and the modulus are the same field element.
    assert_eq!(proof[4..8], [0; 4]);
    proof[4..8].copy_from_slice(&0x7f00_0001u32.to_le_bytes());
    malformed(&proof, "canonical");
}

#[test]
fn every_truncation_is_refused() {
    let proof = mock_proof();
    for end in 0..proof.len() {
        let code = check(&proof[..end]).code;
        assert_eq!(code, RefusalCode::MalformedProof, "{end}");
    }
}

#[test]
fn a_length_beyond_the_bytes_is_refused_without_allocating_it() {
    let proof = mock_proof();
    for at in (4..proof.len() - 8).step_by(4) {
        let mut proof = proof.clone();
        proof[at..at + 8].copy_from_slice(&(u64::MAX / 64).to_le_bytes());
        check(&proof);
    }
}

#[test]
fn a_program_key_has_eight_canonical_elements() {
    assert!(ProgramKey::from_bytes(&[0; 31]).is_err());
    assert!(ProgramKey::from_bytes(&[0; 33]).is_err());
    assert!(ProgramKey::from_bytes(&[0xff; 32]).is_err());
    let below = [0x7f00_0000u32; 8].map(u32::to_le_bytes).concat();
    assert!(ProgramKey::from_bytes(&below).is_ok());
    let modulus = [0x7f00_0001u32; 8].map(u32::to_le_bytes).concat();
    assert!(ProgramKey::from_bytes(&modulus).is_err());
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]

    #[test]
    fn random_bytes_are_refused(tail in proptest::collection::vec(any::<u8>(), 0..2000)) {
        check(&[&[1, 0, 0, 0], &tail[..]].concat());
    }

    #[test]
    fn flipped_bytes_are_refused(flips in proptest::collection::vec((any::<prop::sample::Index>(), 1u8..), 1..4)) {
        let mut proof = mock_proof();
        for (at, flip) in flips {
            let at = at.index(proof.len());
            proof[at] ^= flip;
        }
        check(&proof);
    }
}
