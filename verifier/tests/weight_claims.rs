//! The verifier's half of mode `succinct`: what a proof leaves to check of the weights is what it was, and holds for the files.

use crate::made::{self, file, format, rounded, tensors, terms, unread_of, Tensors};
use zk0_circuits::claim::public_values::CLAIM_VERSION;
use zk0_circuits::{Claim, DatasetCommitment, Digest, EvalSpec, Losses, Mode};
use zk0_protocol::{Refusal, RefusalCode, Rules};
use zk0_testkit::weight_claims;
use zk0_verifier::{check_weight_claims, Evaluation, WeightFiles};

/// What an argument about these weights could leave ([`weight_claims::left`]).
fn left(base: &Tensors, update: &Tensors, seed: u32) -> (Vec<u8>, Digest) {
    let spec = EvalSpec::micro();
    let weights = [base, update].map(|tensors| made::quantise(&spec, tensors));
    weight_claims::left(weights.each_ref(), seed)
}

fn honest() -> (Tensors, Tensors) {
    let spec = EvalSpec::micro();
    let base = rounded(&spec, &tensors(&spec, 1, 4.0));
    let update = unread_of(&base, tensors(&spec, 2, 0.1));
    (base, update)
}

/// What the verifier states of files and what a proof left, which had a digest.
fn told(base: &Tensors, update: &Tensors, left: &[u8], claimed: &Digest) -> Result<(), Refusal> {
    let spec = EvalSpec::micro();
    let (base, update) = (file(&spec, base), file(&spec, update));
    check_weight_claims(&format(&spec), claimed, left, &base[..], &update[..])
}

#[test]
fn claims_hold_for_the_weights_that_were_proven() {
    let (base, update) = honest();
    let (left, digest) = left(&base, &update, 1);
    assert_eq!(told(&base, &update, &left, &digest), Ok(()));
}

/// The update in the file is another one than was evaluated, with the same scales.
#[test]
fn claims_about_other_weights_do_not_hold() {
    let (base, update) = honest();
    let (left, digest) = left(&base, &update, 1);
    for changed in [0, 1] {
        let mut files = [base.clone(), update.clone()];
        for values in files[changed].values_mut() {
            // No value grows, so that scales stay.
            let values = &mut values[..1];
            values[0] /= 2.0;
        }
        let [base, update] = files;
        let refused = told(&base, &update, &left, &digest);
        assert!(
            matches!(
                refused,
                Err(Refusal {
                    code: RefusalCode::OtherModels,
                    ..
                })
            ),
            "{refused:?}"
        );
    }
}

/// What is left is true of the files, but it is not what the proof left.
#[test]
fn other_claims_than_the_proof_left_are_refused() {
    let (base, update) = honest();
    let (_, claimed) = left(&base, &update, 1);
    let (others, _) = left(&base, &update, 1000);
    let refused = Err(RefusalCode::OtherWeightCheck { claimed }.into());
    assert_eq!(told(&base, &update, &others, &claimed), refused);
}

#[test]
fn bytes_after_the_claims_are_refused() {
    let (base, update) = honest();
    let (mut left, claimed) = left(&base, &update, 1);
    left.push(0);
    let refused = Err(RefusalCode::OtherWeightCheck { claimed }.into());
    assert_eq!(told(&base, &update, &left, &claimed), refused);
}

/// What the verifier states of a claim that names a weight check or none, apart from its proof.
fn checked(weight_check: Option<Digest>, left: &[u8]) -> Result<(), Refusal> {
    let spec = EvalSpec::micro();
    let (base, update) = honest();
    let files = WeightFiles {
        base: file(&spec, &base),
        update: file(&spec, &update),
    };
    let dataset = DatasetCommitment {
        root: Digest([3; 32]),
        samples: 1,
        feature_spec: Digest([3; 32]),
        salt_commitment: Digest([3; 32]),
    };
    let claim = Claim {
        version: CLAIM_VERSION,
        terms: terms(&spec, Mode::Succinct, dataset, &files.base, &files.update),
        losses: Losses::Hidden,
        weight_check,
    };
    let evaluation = Evaluation::new(&spec, Mode::Succinct).unwrap();
    let checked = evaluation.check_weights(&claim, left, &files, &Rules::default());
    checked.map(drop)
}

#[test]
fn an_update_is_checked_with_what_its_proof_left() {
    let (base, update) = honest();
    let (own, claimed) = left(&base, &update, 1);
    assert_eq!(checked(Some(claimed), &own), Ok(()));
    let (others, _) = left(&base, &update, 1000);
    let refused = Err(RefusalCode::OtherWeightCheck { claimed }.into());
    assert_eq!(checked(Some(claimed), &others), refused);
}

#[test]
fn a_claim_that_names_no_weight_check_is_refused() {
    let refused = checked(None, &[]);
    assert!(
        matches!(
            refused,
            Err(Refusal {
                code: RefusalCode::Binding(_),
                ..
            })
        ),
        "{refused:?}"
    );
}
