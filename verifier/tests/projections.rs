//! The verifier's half of mode `checked`: the weights that the guest used are those in the files.

use safetensors::tensor::TensorView;
use safetensors::Dtype;
use std::collections::BTreeMap;
use zk0_circuits::claim::challenge::sample_indices;
use zk0_circuits::claim::dataset::{leaf, salt_commitment};
use zk0_circuits::claim::hinted_input::HintedInput;
use zk0_circuits::claim::private_input::{Header, Opening};
use zk0_circuits::claim::statement::check_hinted;
use zk0_circuits::model::layout::expert_tensors;
use zk0_circuits::model::sample::SampleParts;
use zk0_circuits::vm::merkle;
use zk0_circuits::{
    DatasetCommitment, Digest, Disclosure, EvalSpec, Mode, NodeId, PrivateInput, QuantisedWeights,
    Sample, Terms, WeightCheck, WeightsDigest,
};
use zk0_protocol::Refusal;
use zk0_verifier::check_projections;

type Tensors = BTreeMap<String, (Vec<usize>, Vec<f32>)>;

/// Makes small weights that differ with `seed`. The velocity's weights are scaled by `loud`.
fn tensors(spec: &EvalSpec, seed: u32, loud: f32) -> Tensors {
    let mut state = seed;
    let mut next = move || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (state >> 8) as f32 / (1 << 23) as f32 - 1.0
    };
    expert_tensors(&spec.dims)
        .into_iter()
        .map(|tensor| {
            let scale = if tensor.name.contains("action_out") {
                0.4 * loud
            } else {
                0.4
            };
            let values = (0..tensor.len()).map(|_| scale * next()).collect();
            (tensor.name, (tensor.shape, values))
        })
        .collect()
}

fn file(tensors: &Tensors) -> Vec<u8> {
    let bytes: Vec<(&String, &Vec<usize>, Vec<u8>)> = tensors
        .iter()
        .map(|(name, (shape, values))| {
            let bytes = values.iter().flat_map(|value| value.to_le_bytes());
            (name, shape, bytes.collect())
        })
        .collect();
    let views = bytes.iter().map(|(name, shape, bytes)| {
        (
            *name,
            TensorView::new(Dtype::F32, shape.to_vec(), bytes).unwrap(),
        )
    });
    safetensors::serialize(views, None).unwrap()
}

fn quantise(spec: &EvalSpec, tensors: &Tensors) -> QuantisedWeights {
    let get = |name: &str| tensors.get(name).map(|(_, values)| values.as_slice());
    QuantisedWeights::quantise(spec, get).unwrap()
}

/// The weight check of an honest claim about these weights.
fn claimed(spec: &EvalSpec, base: &Tensors, update: &Tensors) -> WeightCheck {
    let dims = &spec.dims;
    let cache = vec![0.25; 3 * dims.kv_width()];
    let cache: Vec<_> = (0..dims.layers).map(|_| (&cache[..], &cache[..])).collect();
    let actions = vec![0.0; (dims.chunk * dims.max_action_dim) as usize];
    let is_pad = vec![false; dims.chunk as usize];
    let parts = SampleParts {
        cache: &cache,
        actions: &actions,
        is_pad: &is_pad,
    };
    let sample = Sample::quantise(spec, parts).unwrap();
    let salt = [5; 32];
    let leaves = [leaf(&salt, &sample.digest())];
    let challenge = Digest([6; 32]);
    let (base, update) = (quantise(spec, base), quantise(spec, update));
    let named = |weights: &QuantisedWeights| WeightsDigest {
        blob: Digest([8; 32]),
        quantised: weights.digest(Mode::Checked),
    };
    let header = Header {
        spec: spec.clone(),
        terms: Terms {
            network: Digest([1; 32]),
            round: 0,
            node: NodeId([2; 32]),
            dataset: DatasetCommitment {
                root: merkle::root(&leaves),
                samples: 1,
                feature_spec: Digest([3; 32]),
                salt_commitment: salt_commitment(&salt),
            },
            evaluation: spec.digest(),
            base: named(&base),
            update: named(&update),
            challenge,
            eval_samples: 1,
            min_improvement_bps: 1,
        },
        disclosure: Disclosure::Losses,
        salt,
    };
    let openings = vec![Opening {
        index: sample_indices(&challenge, 1, 1).unwrap()[0],
        sample,
        path: vec![],
    }];
    let input = PrivateInput {
        header,
        base,
        update,
        openings,
    };
    let hinted = HintedInput::of(&input).unwrap();
    check_hinted(&hinted).unwrap().weight_check.unwrap()
}

#[test]
fn files_are_what_the_guest_used_or_not() {
    let spec = EvalSpec::micro();
    let (base, update) = (tensors(&spec, 1, 4.0), tensors(&spec, 1, 0.1));
    let check = claimed(&spec, &base, &update);
    let verify = |base: &[u8], update: &[u8]| check_projections(&spec, &check, base, update);
    let (base_file, update_file) = (file(&base), file(&update));
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
        let values = &mut other.get_mut(name).unwrap().1;
        let last = values.len() - 1;
        // Rows of the last layer beyond the real action dimensions are in no product.
        let at = if name.contains("action_out") { 0 } else { last };
        values[at] += 0.01;
        assert_eq!(refused(&file(&other), &update_file), "base", "{name}");
    }

    // Another seed gives other coefficients.
    let mut other = check;
    other.seed.0[0] ^= 1;
    let found = check_projections(&spec, &other, &base_file[..], &update_file[..]);
    assert!(matches!(found, Err(Refusal::OtherProducts { .. })));
}

#[test]
fn bad_files_are_refused_by_name() {
    let spec = EvalSpec::micro();
    let good = tensors(&spec, 1, 1.0);
    let check = claimed(&spec, &tensors(&spec, 1, 4.0), &tensors(&spec, 1, 0.1));
    let good_file = file(&good);
    let said = |update: &[u8]| match check_projections(&spec, &check, &good_file[..], update) {
        Err(Refusal::MalformedUpdate(why)) => why,
        other => panic!("{other:?}"),
    };
    let name = "model.action_in_proj.weight";
    let mut missing = good.clone();
    missing.remove(name);
    assert!(said(&file(&missing)).contains("action_in_proj.weight' is missing"));
    let mut infinite = good.clone();
    infinite.get_mut(name).unwrap().1[3] = f32::INFINITY;
    assert!(said(&file(&infinite)).contains("action_in_proj.weight[3] is inf"));
    let mut reshaped = good.clone();
    reshaped.get_mut(name).unwrap().0.reverse();
    assert!(said(&file(&reshaped)).contains("expected ["));
    for cut in [0, 7, 100, good_file.len() / 2, good_file.len() - 1] {
        said(&good_file[..cut]);
    }
    let mut header = good_file.clone();
    header[..8].copy_from_slice(&u64::MAX.to_le_bytes());
    said(&header);
}
