//! The verifier's half of mode `checked`: the weights that the guest used are those in the files.

mod made;

use made::{file, format, rounded, sample, tensors, terms, unread_of, Tensors};
use zk0_circuits::claim::challenge::sample_indices;
use zk0_circuits::claim::dataset::{leaf, salt_commitment};
use zk0_circuits::claim::hinted_input::HintedInput;
use zk0_circuits::claim::private_input::{Header, Opening};
use zk0_circuits::claim::public_values::CLAIM_VERSION;
use zk0_circuits::vm::merkle;
use zk0_circuits::{
    Claim, DatasetCommitment, Digest, Disclosure, EvalSpec, Losses, Mode, PrivateInput, WeightCheck,
};
use zk0_protocol::{Refusal, Rules};
use zk0_verifier::{check_projections, Evaluation, WeightFiles};

/// The weight check of an honest claim about these weights.
fn claimed(spec: &EvalSpec, base: &Tensors, update: &Tensors) -> WeightCheck {
    let sample = sample(spec);
    let salt = [5; 32];
    let leaves = [leaf(&salt, &sample.digest())];
    let dataset = DatasetCommitment {
        root: merkle::root(&leaves),
        samples: 1,
        feature_spec: Digest([3; 32]),
        salt_commitment: salt_commitment(&salt),
    };
    let files = [file(spec, base), file(spec, update)];
    let header = Header {
        spec: spec.clone(),
        terms: terms(spec, Mode::Checked, dataset, &files[0], &files[1]),
        disclosure: Disclosure::Losses,
        salt,
    };
    let openings = vec![Opening {
        index: sample_indices(&header.terms.challenge, 1, 1).unwrap()[0],
        sample,
        path: vec![],
    }];
    let input = PrivateInput {
        header,
        base: made::quantise(spec, base),
        update: made::quantise(spec, update),
        openings,
    };
    HintedInput::of(&input).unwrap().weight_check()
}

#[test]
fn files_are_what_the_guest_used_or_not() {
    let spec = EvalSpec::micro();
    let format = format(&spec);
    let (base, update) = (tensors(&spec, 1, 4.0), tensors(&spec, 1, 0.1));
    let check = claimed(&spec, &base, &update);
    let verify = |base: &[u8], update: &[u8]| check_projections(&format, &check, base, update);
    let (base_file, update_file) = (file(&spec, &base), file(&spec, &update));
    assert_eq!(verify(&base_file, &update_file), Ok(()));
    let refused = |base: &[u8], update: &[u8]| match verify(base, update) {
        Err(Refusal::OtherProducts { which }) => which,
        other => panic!("{other:?}"),
    };
    assert_eq!(refused(&update_file, &update_file), "base");
    assert_eq!(refused(&base_file, &base_file), "update");

    // One weight of each tensor is changed by more than the rounding hides.
    for name in base.keys() {
        let mut other = base.clone();
        let values = other.get_mut(name).unwrap();
        let last = values.len() - 1;
        // Rows of the last layer beyond the real action dimensions are in no product.
        let at = if name.contains("action_out") { 0 } else { last };
        values[at] += 0.01;
        let other = file(&spec, &other);
        assert_eq!(refused(&other, &update_file), "base", "{name}");
    }

    // Another seed gives other coefficients.
    let mut other = check;
    other.seed.0[0] ^= 1;
    let found = check_projections(&format, &other, &base_file[..], &update_file[..]);
    assert!(matches!(found, Err(Refusal::OtherProducts { .. })));
}

/// The products are those of the files, but they are not what the proof was about.
#[test]
fn other_products_than_the_proof_left_are_refused() {
    let spec = EvalSpec::micro();
    let base = rounded(&spec, &tensors(&spec, 1, 4.0));
    let update = |seed| unread_of(&base, tensors(&spec, seed, 0.1));
    let own = claimed(&spec, &base, &update(1));
    let proven = claimed(&spec, &base, &update(2)).digest();
    let files = WeightFiles {
        base: file(&spec, &base),
        update: file(&spec, &update(1)),
    };
    let dataset = DatasetCommitment {
        root: Digest([3; 32]),
        samples: 1,
        feature_spec: Digest([3; 32]),
        salt_commitment: Digest([3; 32]),
    };
    let claim = |weight_check| Claim {
        version: CLAIM_VERSION,
        terms: terms(&spec, Mode::Checked, dataset, &files.base, &files.update),
        losses: Losses::Hidden,
        weight_check: Some(weight_check),
    };
    let evaluation = Evaluation::new(&spec, Mode::Checked).unwrap();
    let bytes = borsh::to_vec(&own).unwrap();
    let checked = |claim: &Claim| {
        let checked = evaluation.check_weights(claim, &bytes, &files, &Rules::default());
        checked.map(drop)
    };
    assert_eq!(checked(&claim(own.digest())), Ok(()));
    let refused = Refusal::OtherWeightCheck { claimed: proven };
    assert_eq!(checked(&claim(proven)), Err(refused));
}

#[test]
fn bad_files_are_refused_by_name() {
    let spec = EvalSpec::micro();
    let format = format(&spec);
    let check = claimed(&spec, &tensors(&spec, 1, 4.0), &tensors(&spec, 1, 0.1));
    let good = file(&spec, &tensors(&spec, 1, 1.0));
    let said = |update: &[u8]| match check_projections(&format, &check, &good[..], update) {
        Err(Refusal::MalformedUpdate(why)) => why,
        other => panic!("{other:?}"),
    };
    // The first scale comes first in the data, and the last value last.
    let data = 8 + u64::from_le_bytes(good[..8].try_into().unwrap()) as usize;
    let mut scale = good.clone();
    scale[data] = 77;
    assert!(said(&scale).contains("'model.action_in_proj.weight' has 77 fraction bits"));
    let mut value = good.clone();
    let last = value.len() - 2;
    value[last..].copy_from_slice(&i16::MIN.to_le_bytes());
    assert!(said(&value).contains("'model.action_out_proj.bias' holds -32768 at element 7"));
    for cut in [0, 7, 100, good.len() / 2, good.len() - 1] {
        assert!(said(&good[..cut]).contains("truncated"));
    }
    let mut header = good.clone();
    header[..8].copy_from_slice(&u64::MAX.to_le_bytes());
    said(&header);
}
