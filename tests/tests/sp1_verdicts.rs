//! `SP1CompressedVerifier` is the oracle: on a real proof, and on that proof with one bit changed, in all its parts, our
//! verifier says what SP1's says, for the same reason.

use sp1_verifier::{
    compressed::{CompressedError, SP1CompressedVerifier},
    SP1Proof,
};
use std::panic::{catch_unwind, AssertUnwindSafe};
use zk0_circuits::{Claim, Digest};
use zk0_ledger::Refusal;
use zk0_tests::{accepted, ledger_copy};
use zk0_verifier::{check_proof, ProgramKey};

struct Oracle(SP1CompressedVerifier);

impl Oracle {
    /// SP1's verdict, as ours would be; none if it cannot decode the bytes.
    fn check(&self, proof: &[u8], claim: &Claim, key: &[u8]) -> Option<Result<(), Refusal>> {
        let SP1Proof::Compressed(proof) = bincode::deserialize(proof).ok()? else {
            return None;
        };
        let key = bincode::deserialize(key).expect("a program's key");
        let claim = borsh::to_vec(claim).expect("a claim");
        let verdict = catch_unwind(AssertUnwindSafe(|| {
            self.0
                .verify_compressed_with_public_values(&proof, &claim, &key)
        }));
        Some(match verdict {
            Ok(Ok(())) => Ok(()),
            Ok(Err(CompressedError::PublicValuesMismatch)) => Err(Refusal::OtherClaim),
            Ok(Err(error)) => {
                let text = error.to_string();
                let text = text.trim_start_matches("failed to verify proof: ");
                let text = text.trim_start_matches("invalid public values: ");
                Err(match text {
                    "sp1 vk hash mismatch" => Refusal::OtherProgram,
                    text => Refusal::InvalidProof(text.into()),
                })
            }
            Err(_) => Err(Refusal::InvalidProof("SP1's verifier gave up on it".into())),
        })
    }
}

/// Asserts that both say the same, and returns it.
fn verdict(oracle: &Oracle, proof: &[u8], claim: &Claim, key: &[u8]) -> Result<(), Refusal> {
    let program = ProgramKey::from_bytes(key).unwrap();
    let ours = check_proof(proof, claim, &program);
    match (oracle.check(proof, claim, key), &ours) {
        // We refuse a second encoding of the same proof, which SP1 accepts.
        (_, Err(Refusal::MalformedProof(cause))) if cause.contains("canonical") => {}
        (None, Err(Refusal::MalformedProof(_))) => {}
        (Some(theirs), _) => assert_eq!(theirs, ours),
        (None, ours) => panic!("SP1 cannot decode what we find {ours:?}"),
    }
    ours
}

#[test]
fn our_verdicts_are_those_of_sp1s_own_verifier() {
    let real = accepted(ledger_copy().path());
    let (proof, claim) = (
        &real.contribution.proof,
        &real.contribution.submission.statement.claim,
    );
    let key = &real.state.genesis().program;
    let oracle = Oracle(SP1CompressedVerifier::new());

    assert_eq!(verdict(&oracle, proof, claim, key), Ok(()));
    let mut other = claim.clone();
    other.challenge = Digest([0; 32]);
    assert_eq!(
        verdict(&oracle, proof, &other, key),
        Err(Refusal::OtherClaim)
    );
    let mut other = key.clone();
    other[28] ^= 1;
    assert_eq!(
        verdict(&oracle, proof, claim, &other),
        Err(Refusal::OtherProgram)
    );

    // Places all over the proof, and more of them at its ends: SP1's key and public values, and the key's Merkle proof.
    let length = proof.len();
    let all_over = (1..120).map(|i| i * (length / 120));
    let places = (4..300)
        .step_by(16)
        .chain(all_over)
        .chain((length - 300..length).step_by(8));
    let mut reasons = std::collections::BTreeMap::new();
    for place in places {
        let mut changed = proof.clone();
        // Little endian: an element or a length that is one more or less.
        changed[place / 4 * 4] ^= 1;
        let refusal = verdict(&oracle, &changed, claim, key).expect_err("a changed proof");
        *reasons.entry(refusal.to_string()).or_insert(0) += 1;
    }
    // The comparison reached what is checked around the shard proof, and several depths of that.
    eprintln!("{reasons:#?}");
    assert!(reasons
        .keys()
        .any(|reason| reason.ends_with("incorrect vkey")));
    assert!(reasons.len() >= 5, "{reasons:?}");
}
