//! A contribution with a real SP1 proof is accepted. With one thing changed, it is refused for the reason that belongs to the change.

use crate::real_ledger::{accepted, ledger_copy, with_rules, Accepted};
use ed25519_dalek::SigningKey;
use zk0_circuits::claim::student::Confidence;
use zk0_circuits::{Claim, Digest, Losses};
use zk0_protocol::entries::program::{Program, FOUNDING_SP1, OUR_SP1};
use zk0_protocol::entries::signed::Signed;
use zk0_protocol::{Genesis, Refusal, RefusalCode, State};
use zk0_verifier::decide::decide;
use zk0_verifier::releases::can_verify;
use zk0_verifier::{
    authenticate, blob_digest, check_proof, CheckedClaim, ProgramKey, UnverifiedContribution,
    VerifiedContribution,
};

fn real() -> Accepted {
    accepted(ledger_copy().path())
}

fn verify(
    contribution: &UnverifiedContribution,
    state: &State,
    time_ms: u64,
) -> Result<VerifiedContribution, Refusal> {
    let UnverifiedContribution {
        submission,
        proof,
        weights,
    } = contribution.clone();
    let context = state.claim_context(&submission.statement.claim.terms.node);
    let authentic = authenticate(submission, proof, &context)?;
    zk0_verifier::verify(&authentic, &weights, &context, time_ms)
}

fn refusal(real: &Accepted, contribution: &UnverifiedContribution) -> RefusalCode {
    let refused = verify(contribution, &real.state, real.time_ms);
    refused.expect_err("has to be refused").code
}

/// The refusals of a contribution whose claim is changed. A cheat who holds the node's key would sign it again, but the keys of the
/// fixture's nodes are not here. The signature is then the first thing that is wrong, so the checks that come after it are called
/// alone.
fn check_changed(real: &Accepted, change: impl FnOnce(&mut Claim)) -> (RefusalCode, RefusalCode) {
    let mut changed = real.contribution.clone();
    change(&mut changed.submission.statement.claim);
    let claim = &changed.submission.statement.claim;
    let key = ProgramKey::from_bytes(&real.state.genesis().program).unwrap();
    let by_ledger = real
        .state
        .check_claim(claim, real.time_ms)
        .expect_err("the ledger fixes this");
    let by_proof =
        check_proof(&changed.proof, claim, &key).expect_err("the proof states otherwise");
    assert!(matches!(refusal(real, &changed), RefusalCode::Signature));
    (by_ledger.code, by_proof.code)
}

#[test]
fn the_real_contribution_is_accepted() {
    let real = real();
    let verified = verify(&real.contribution, &real.state, real.time_ms).unwrap();
    assert_eq!(
        verified.claim(),
        &real.contribution.submission.statement.claim
    );
}

/// Returns the state with another program in force. The genesis stays as it is.
fn with_program(state: &State, program: &Program) -> State {
    let encoded = borsh::to_vec(state.program()).unwrap();
    let mut bytes = borsh::to_vec(state).unwrap();
    let mut windows = bytes.windows(encoded.len());
    let at = windows.position(|window| window == encoded).unwrap();
    bytes.splice(at..at + encoded.len(), borsh::to_vec(program).unwrap());
    let changed: State = borsh::from_slice(&bytes).unwrap();
    assert_eq!(
        (changed.program(), changed.genesis()),
        (program, state.genesis())
    );
    changed
}

#[test]
fn a_proof_of_the_first_program_is_refused_once_another_one_is_in_force() {
    let real = real();
    let mut next = real.state.program().clone();
    assert_eq!(next, Program::founding(&real.state.genesis().program));
    next.key[0] ^= 1;
    let state = with_program(&real.state, &next);
    assert_eq!(
        verify(&real.contribution, &state, real.time_ms),
        Err(RefusalCode::OtherProgram.into())
    );
    // The same proof counts in a network that was founded with another program and has changed to this one. It does not before.
    let founded_with = |key: &[u8]| {
        let (own, other) = (real.state.genesis(), key.to_vec());
        let genesis = Genesis {
            program: other,
            ..own.clone()
        };
        let own = borsh::to_vec(own).unwrap();
        let bytes = borsh::to_vec(&real.state).unwrap();
        let bytes = [
            borsh::to_vec(&genesis).unwrap(),
            bytes[own.len()..].to_vec(),
        ]
        .concat();
        borsh::from_slice::<State>(&bytes).unwrap()
    };
    let after = founded_with(&next.key);
    assert!(verify(&real.contribution, &after, real.time_ms).is_ok());
    let before = with_program(&after, &next);
    assert_eq!(
        verify(&real.contribution, &before, real.time_ms),
        Err(RefusalCode::OtherProgram.into())
    );
}

#[test]
fn without_the_verifier_of_its_release_a_proof_is_neither_right_nor_wrong() {
    let real = real();
    let later = Program {
        sp1: "6.10.1".into(),
        ..real.state.program().clone()
    };
    let state = with_program(&real.state, &later);
    let expected = RefusalCode::NoVerifier;
    assert_eq!(
        verify(&real.contribution, &state, real.time_ms),
        Err(expected.into())
    );
    // Another build could accept the proof, so the ledger records nothing, and the node can submit it again.
    assert!(!expected.follows_from_blobs());
    let UnverifiedContribution {
        submission,
        proof,
        weights,
    } = real.contribution.clone();
    let context = state.claim_context(&submission.statement.claim.terms.node);
    let authentic = authenticate(submission, proof, &context).unwrap();
    let checked = CheckedClaim::of(authentic.claim(), &context, real.time_ms).unwrap();
    assert_eq!(
        decide(&checked, &authentic, &weights, context.terms()),
        Err(expected.into())
    );
}

/// The names of releases are not read from what cargo has built, so they have to be the same.
#[test]
fn the_releases_of_sp1_are_those_that_cargo_builds() {
    let lock = include_str!("../../../Cargo.lock");
    for name in ["sp1-verifier", "sp1-sdk", "sp1-prover"] {
        let line = format!("name = \"{name}\"\nversion = \"{OUR_SP1}\"\n");
        assert!(lock.contains(&line), "{name} is not of release {OUR_SP1}");
        assert_eq!(lock.matches(&format!("name = \"{name}\"\n")).count(), 1);
    }
    // Ledgers rest on this one, whatever cargo builds.
    assert_eq!(FOUNDING_SP1, "6.10.0");
    assert!(can_verify(&Program::founding(&[0; 32])));
}

#[test]
fn an_update_too_far_from_its_base_is_refused() {
    let real = real();
    let limited = |bps| {
        let state = with_rules(&real.state, |rules| rules.max_update_norm_bps = bps);
        verify(&real.contribution, &state, real.time_ms)
    };
    let Err(Refusal {
        code: RefusalCode::TooFar { bps, limit: 1 },
        ..
    }) = limited(1)
    else {
        panic!("one basis point is less than any training");
    };
    let bps = u32::try_from(bps).unwrap();
    assert!(limited(bps).is_ok());
    assert!(matches!(
        limited(bps - 1),
        Err(Refusal {
            code: RefusalCode::TooFar { .. },
            ..
        })
    ));
}

#[test]
fn a_flipped_byte_in_the_proof_is_refused() {
    let real = real();
    let claim = &real.contribution.submission.statement.claim;
    let key = ProgramKey::from_bytes(&real.state.genesis().program).unwrap();
    let length = real.contribution.proof.len();
    for at in [
        0,
        4,
        100,
        length / 4,
        length / 2,
        length * 3 / 4,
        length - 1,
    ] {
        let mut changed = real.contribution.clone();
        changed.proof[at] ^= 1;
        // The node signed the proof's digest, so a flipped byte is seen before SP1 is asked.
        assert!(
            matches!(refusal(&real, &changed), RefusalCode::ProofDigest { .. }),
            "byte {at}"
        );
        // SP1 itself refuses the changed proof, even if the node might have signed it.
        let by_proof = check_proof(&changed.proof, claim, &key);
        let by_proof = by_proof.expect_err("a changed proof").code;
        assert!(
            matches!(
                by_proof,
                RefusalCode::MalformedProof
                    | RefusalCode::InvalidProof
                    | RefusalCode::OtherClaim
                    | RefusalCode::OtherProgram
            ),
            "byte {at}: {by_proof}"
        );
    }
}

#[test]
fn a_truncated_or_extended_proof_is_malformed() {
    let real = real();
    let claim = &real.contribution.submission.statement.claim;
    let key = ProgramKey::from_bytes(&real.state.genesis().program).unwrap();
    let proof = &real.contribution.proof;
    for cut in [0, 3, 4, 5, 1000, proof.len() / 2, proof.len() - 1] {
        assert!(
            matches!(
                check_proof(&proof[..cut], claim, &key),
                Err(Refusal {
                    code: RefusalCode::MalformedProof,
                    ..
                })
            ),
            "cut to {cut}"
        );
    }
    let longer = [&proof[..], &[0]].concat();
    assert!(matches!(
        check_proof(&longer, claim, &key),
        Err(Refusal {
            code: RefusalCode::MalformedProof,
            ..
        })
    ));
}

/// The real claim with a lower loss after the training. The ledger does not know the losses.
fn with_another_loss(real: &Accepted) -> Claim {
    let mut claim = real.contribution.submission.statement.claim.clone();
    let Losses::Disclosed {
        before,
        after,
        elements,
    } = claim.losses
    else {
        panic!("the fixture discloses losses")
    };
    claim.losses = Losses::Disclosed {
        before,
        after: after - 1,
        elements,
    };
    claim
}

#[test]
fn only_the_claim_that_was_compared_with_the_ledger_counts() {
    let real = real();
    let UnverifiedContribution {
        submission,
        proof,
        weights,
    } = real.contribution.clone();
    let context = real
        .state
        .claim_context(&submission.statement.claim.terms.node);
    let other = with_another_loss(&real);
    let checked = CheckedClaim::of(&other, &context, real.time_ms).unwrap();
    let authentic = authenticate(submission, proof, &context).unwrap();
    let refused = decide(&checked, &authentic, &weights, context.terms()).unwrap_err();
    assert!(refused.detail.contains("another claim"), "{refused}");
}

#[test]
fn changed_public_values_are_another_claim() {
    let real = real();
    let claim = with_another_loss(&real);
    let key = ProgramKey::from_bytes(&real.state.genesis().program).unwrap();
    assert_eq!(
        check_proof(&real.contribution.proof, &claim, &key),
        Err(RefusalCode::OtherClaim.into())
    );
}

#[test]
fn another_programs_key_is_refused() {
    let real = real();
    let claim = &real.contribution.submission.statement.claim;
    let mut key: Vec<u8> = real.state.genesis().program.clone();
    key[0] ^= 1;
    let key = ProgramKey::from_bytes(&key).unwrap();
    assert_eq!(
        check_proof(&real.contribution.proof, claim, &key),
        Err(RefusalCode::OtherProgram.into())
    );
}

#[test]
fn a_flipped_bit_in_the_signature_is_refused() {
    let real = real();
    for at in [0, 31, 32, 63] {
        let mut changed = real.contribution.clone();
        changed.submission.signature[at] ^= 1;
        assert!(
            matches!(refusal(&real, &changed), RefusalCode::Signature),
            "byte {at}"
        );
    }
}

#[test]
fn another_nodes_signature_is_refused() {
    let real = real();
    let mut changed = real.contribution.clone();
    changed.submission = Signed::new(
        changed.submission.statement,
        &SigningKey::from_bytes(&[7; 32]),
    );
    assert!(matches!(refusal(&real, &changed), RefusalCode::Signature));
}

#[test]
fn other_weights_than_those_committed_are_refused() {
    let real = real();
    let mut changed = real.contribution.clone();
    *changed.weights.update.last_mut().unwrap() ^= 1;
    assert!(matches!(
        refusal(&real, &changed),
        RefusalCode::UpdateDigest { .. }
    ));
}

#[test]
fn other_weights_than_those_proven_are_refused() {
    let real = real();
    let claim = &real.contribution.submission.statement.claim;
    let mut update = real.contribution.weights.update.clone();
    // The last value, a bias, changes by one step of its scale.
    let last = update.len() - 2;
    update[last] ^= 1;
    let mut digest = claim.terms.update;
    digest.blob = blob_digest(&update);
    let evaluation = zk0_verifier::Evaluation::of(&real.state).unwrap();
    match evaluation.check_update(&update, &digest) {
        Err(Refusal {
            code: RefusalCode::OtherWeights { proven, .. },
            ..
        }) => {
            assert_eq!(proven, claim.terms.update.quantised)
        }
        other => panic!("{other:?}"),
    }
}

#[test]
fn every_field_the_ledger_fixes_is_bound() {
    let real = real();
    let flip = |digest: &mut Digest| digest.0[31] ^= 1;
    let changes: [(&str, Box<dyn Fn(&mut Claim)>); 11] = [
        (
            "dataset.root",
            Box::new(|claim| flip(&mut claim.terms.dataset.root)),
        ),
        (
            "dataset.samples",
            Box::new(|claim| claim.terms.dataset.samples += 1),
        ),
        (
            "dataset.feature_spec",
            Box::new(|claim| flip(&mut claim.terms.dataset.feature_spec)),
        ),
        (
            "dataset.salt_commitment",
            Box::new(|claim| flip(&mut claim.terms.dataset.salt_commitment)),
        ),
        (
            "evaluation",
            Box::new(|claim| flip(&mut claim.terms.evaluation)),
        ),
        ("base", Box::new(|claim| flip(&mut claim.terms.base.blob))),
        (
            "update",
            Box::new(|claim| flip(&mut claim.terms.update.quantised)),
        ),
        (
            "challenge",
            Box::new(|claim| flip(&mut claim.terms.challenge)),
        ),
        (
            "eval_samples",
            Box::new(|claim| claim.terms.eval_samples -= 1),
        ),
        (
            "test.min_improvement_bps",
            Box::new(|claim| claim.terms.test.min_improvement_bps -= 1),
        ),
        (
            "test.confidence",
            Box::new(|claim| claim.terms.test.confidence = Confidence::P999),
        ),
    ];
    for (name, change) in changes {
        let (by_ledger, by_proof) = check_changed(&real, change);
        let RefusalCode::Binding(field) = by_ledger else {
            panic!("{name}: {by_ledger}")
        };
        let field = field.to_string();
        assert!(field.starts_with(name), "{name} reported as {field}");
        assert_eq!(by_proof, RefusalCode::OtherClaim, "{name}");
    }
}

#[test]
fn another_network_round_or_node_is_refused() {
    let real = real();
    let (by_ledger, _) = check_changed(&real, |claim| claim.terms.network.0[0] ^= 1);
    assert!(matches!(by_ledger, RefusalCode::WrongNetwork { .. }));
    let (by_ledger, _) = check_changed(&real, |claim| claim.terms.round += 1);
    assert!(matches!(by_ledger, RefusalCode::WrongRound { .. }));
}

#[test]
fn a_second_submission_is_refused() {
    let real = real();
    let entry = zk0_protocol::Entry {
        version: zk0_protocol::entries::entry::ENTRY_VERSION,
        time_ms: real.time_ms,
        body: zk0_protocol::Body::ContributionAccepted(real.contribution.submission.clone()),
    };
    let mut after = real.state.clone();
    after.apply(&Digest::default(), &entry).unwrap();
    let second = verify(&real.contribution, &after, real.time_ms);
    assert!(
        matches!(
            second,
            Err(Refusal {
                code: RefusalCode::Duplicate { .. },
                ..
            })
        ),
        "{second:?}"
    );
}
