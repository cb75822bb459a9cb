//! Properties of trees, encodings and quantisation on random input. Hostile input is refused and never causes a panic.

use proptest::prelude::*;
use zk0_circuits::claim::challenge::{sample_indices, MAX_EVAL_SAMPLES};
use zk0_circuits::model::arithmetic::tables::flow_time;
use zk0_circuits::model::draw::draw;
use zk0_circuits::model::eval::{evaluate, Evaluator, Overflow};
use zk0_circuits::model::layout::expert_tensors;
use zk0_circuits::model::linear::{linears, HALF};
use zk0_circuits::model::quantise::QuantiseError;
use zk0_circuits::model::sample::SampleParts;
use zk0_circuits::model::site::EvalError;
use zk0_circuits::model::spec::{Dims, SpecError};
use zk0_circuits::model::weights::WeightsError;
use zk0_circuits::vm::merkle;
use zk0_circuits::vm::values::Values;
use zk0_circuits::{Digest, EvalSpec, PrivateInput, QuantisedWeights, Sample};
use zk0_testkit::claims::{honest, quantise, tensors, FloatSample, Random, Tensors};

fn leaves(count: usize) -> Vec<Digest> {
    (0..count)
        .map(|index| merkle::leaf_hash(&index.to_le_bytes()))
        .collect()
}

/// The flow time of the sample at `position` of `count`.
fn time_of(challenge: [u8; 32], position: u32, count: u32) -> u16 {
    draw(&EvalSpec::micro(), &Digest(challenge), position, count).time
}

proptest! {
    #[test]
    fn every_leaf_has_a_path_that_fits_nothing_else(count in 1usize..70, index in 0usize..70, wrong in 0u64..80) {
        let (leaves, index) = (leaves(count), index % count);
        let root = merkle::root(&leaves);
        let path = merkle::path(&leaves, index).unwrap();
        prop_assert!(merkle::verify(&root, count as u64, index as u64, &leaves[index], &path));
        if wrong != index as u64 {
            prop_assert!(!merkle::verify(&root, count as u64, wrong, &leaves[index], &path));
        }
        let other = merkle::leaf_hash(b"other");
        prop_assert!(!merkle::verify(&root, count as u64, index as u64, &other, &path));
        prop_assert_eq!(merkle::path(&leaves, count), None);
        let mut longer = path.clone();
        longer.push(other);
        prop_assert!(!merkle::verify(&root, count as u64, index as u64, &leaves[index], &longer));
        if let Some((_, shorter)) = path.split_last() {
            prop_assert!(!merkle::verify(&root, count as u64, index as u64, &leaves[index], shorter));
        }
    }

    #[test]
    fn indices_are_distinct_and_in_range(seed: [u8; 32], available in 1u64..5000, count in 1u32..40) {
        let drawn = sample_indices(&Digest(seed), available, count);
        if count as u64 > available {
            prop_assert!(drawn.is_err());
        } else {
            let mut drawn = drawn.unwrap();
            prop_assert!(drawn.iter().all(|&index| index < available));
            drawn.sort_unstable();
            drawn.dedup();
            prop_assert_eq!(drawn.len(), count as usize);
        }
    }

    #[test]
    fn each_time_lies_in_its_own_part_of_the_distribution(challenge: [u8; 32], count in 1u32..=MAX_EVAL_SAMPLES, position: u32) {
        let position = position % count;
        let (drawn, parts) = (time_of(challenge, position, count), u64::from(count));
        // The distribution as a table of 2^12 quantiles. A part may begin and end within one of them.
        let quantiles = |position: u32| u64::from(position) << 12;
        let (first, last) = (quantiles(position) / parts, (quantiles(position + 1) - 1) / parts);
        let part = flow_time(first as u16)..=flow_time(last as u16);
        prop_assert!(part.contains(&drawn), "time {} of {} is {}, but its part is {:?}", position, count, drawn, part);
    }

    #[test]
    fn values_survive_their_bytes(list in prop::collection::vec(any::<i16>(), 0..50)) {
        let values = Values::from_slice(&list);
        prop_assert_eq!(values.as_bytes().len(), Values::byte_len(list.len()));
        let read = Values::from_bytes(values.as_bytes(), list.len()).unwrap();
        prop_assert_eq!(read.as_slice(), &list[..]);
        prop_assert_eq!(read, values);
    }

    #[test]
    fn mutilated_specifications_do_not_panic(at in 0usize..300, byte: u8, keep in 0usize..300) {
        let mut bytes = EvalSpec::micro().encode();
        let len = bytes.len();
        bytes[at % len] = byte;
        if let Ok(spec) = EvalSpec::decode(&bytes) {
            // An accepted specification can be evaluated, or the evaluation returns an error.
            if spec.dims == Dims::MICRO {
                let honest = honest(&EvalSpec::micro(), 3, 2, 1).input;
                let draw = draw(&spec, &Digest([0; 32]), 0, 1);
                let _ = evaluate(&spec, &honest.base, &honest.openings[0].sample, &draw, Overflow::Refused);
            }
        }
        prop_assert!(EvalSpec::decode(&bytes[..keep % len]).is_err());
    }

    #[test]
    fn mutilated_private_inputs_do_not_panic(buffer in 0usize..4, at: usize, byte: u8) {
        let mut buffers = honest(&EvalSpec::micro(), 3, 2, 1).input.to_buffers();
        let len = buffers[buffer].len();
        buffers[buffer][at % len] = byte;
        if let Ok(input) = PrivateInput::from_buffers(&buffers) {
            let _ = zk0_circuits::claim::statement::check(&input);
        }
    }

    #[test]
    fn quantised_weights_are_within_half_a_step(list in prop::collection::vec(-3.0f32..3.0, 12)) {
        let spec = EvalSpec::micro();
        let mut tensors = tensors(&spec, &mut Random(3), 1.0);
        let name = "model.vlm_with_expert.lm_expert.norm.weight";
        tensors.insert(name.into(), list.clone());
        let quantised = quantise(&spec, &tensors);
        let bytes = quantised.as_bytes();
        let value = |index: usize| i16::from_le_bytes([bytes[2 * index], bytes[2 * index + 1]]);
        let all = expert_tensors(&spec.dims);
        let position = all.iter().position(|tensor| tensor.name == name).unwrap();
        let start = all.len() + all[..position].iter().map(|tensor| tensor.len()).sum::<usize>();
        let scale = (1u64 << value(position)) as f64;
        let largest = list.iter().fold(0f32, |largest, x| largest.max(x.abs())) as f64;
        prop_assert!(largest * scale <= 32767.5 && (value(position) == 24 || largest * scale * 2.0 > 32767.0));
        for (index, x) in list.iter().enumerate() {
            prop_assert!((value(start + index) as f64 - *x as f64 * scale).abs() <= 0.5);
        }
    }
}

#[test]
fn unusable_weights_are_refused_by_name() {
    let spec = EvalSpec::micro();
    let good = tensors(&spec, &mut Random(3), 1.0);
    let name = "model.action_time_mlp_in.weight";
    let refuse = |change: &dyn Fn(&mut Tensors)| {
        let mut tensors = good.clone();
        change(&mut tensors);
        QuantisedWeights::quantise(&spec, |name| tensors.get(name).map(Vec::as_slice)).unwrap_err()
    };
    for value in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        let error = refuse(&|tensors| tensors.get_mut(name).unwrap()[5] = value);
        assert!(
            matches!(&error, QuantiseError::NotFinite { name: n, index: 5, .. } if n == name),
            "{error}"
        );
    }
    let error = refuse(&|tensors| tensors.get_mut(name).unwrap()[7] = 40000.0);
    assert!(
        matches!(&error, QuantiseError::TooLarge { name: n, index: 7, .. } if n == name),
        "{error}"
    );
    let error = refuse(&|tensors| drop(tensors.remove(name)));
    assert_eq!(error, QuantiseError::Missing(name.into()));
    let error = refuse(&|tensors| tensors.get_mut(name).unwrap().push(0.0));
    assert!(
        matches!(
            &error,
            QuantiseError::Length {
                expected: 288,
                found: 289,
                ..
            }
        ),
        "{error}"
    );
    // Zeros, subnormals and the largest value that fits are accepted.
    for value in [0.0, f32::MIN_POSITIVE / 2.0, 32767.0] {
        let mut tensors = good.clone();
        tensors.get_mut(name).unwrap().fill(value);
        assert!(
            QuantisedWeights::quantise(&spec, |name| tensors.get(name).map(Vec::as_slice)).is_ok()
        );
    }
}

#[test]
fn unusable_samples_are_refused_by_part() {
    let spec = EvalSpec::micro();
    let refuse = |change: &dyn Fn(&mut FloatSample)| {
        let mut parts = FloatSample::random(&spec, &mut Random(3), 9, 1);
        change(&mut parts);
        let cache: Vec<_> = parts.cache.iter().map(|(k, v)| (&k[..], &v[..])).collect();
        let (actions, is_pad) = (&parts.actions[..], &parts.is_pad[..]);
        Sample::quantise(
            &spec,
            SampleParts {
                cache: &cache,
                actions,
                is_pad,
            },
        )
        .unwrap_err()
        .to_string()
    };
    let reported = [
        refuse(&|parts| parts.actions[3] = f32::NAN),
        refuse(&|parts| parts.actions[3] = 16.5),
        refuse(&|parts| parts.cache[1].0[3] = 1e9),
        refuse(&|parts| drop(parts.cache.pop())),
        refuse(&|parts| parts.is_pad.truncate(3)),
        refuse(&|parts| parts.cache[1].1.truncate(3)),
        refuse(&|parts| {
            parts
                .cache
                .iter_mut()
                .for_each(|(k, v)| (k.clear(), v.clear()).0)
        }),
        refuse(&|parts| {
            parts
                .cache
                .iter_mut()
                .for_each(|(k, v)| (k.resize(14 * 8, 0.0), v.resize(14 * 8, 0.0)).0)
        }),
    ];
    for (reported, part) in reported.iter().zip([
        "actions[3]",
        "actions[3]",
        "keys of layer 1[3]",
        "cache",
        "pad mask",
        "values of layer 1",
        "prefix",
        "prefix",
    ]) {
        assert!(
            reported.contains(part),
            "'{reported}' does not name '{part}'"
        );
    }
}

#[test]
fn buffers_of_other_dimensions_are_refused() {
    let spec = EvalSpec::micro();
    let mut larger = Dims::MICRO;
    larger.expert_mlp = 40;
    let larger = EvalSpec::new(larger);
    let weights = quantise(&larger, &tensors(&larger, &mut Random(1), 1.0));
    let sample = FloatSample::random(&spec, &mut Random(1), 4, 0).quantise(&spec);
    let draw = draw(&spec, &Digest([0; 32]), 0, 1);
    let error = evaluate(&spec, &weights, &sample, &draw, Overflow::Refused).unwrap_err();
    assert_eq!(error, EvalError::Dimensions("the weights"));
    assert!(matches!(
        QuantisedWeights::from_bytes(&spec, weights.as_bytes()),
        Err(WeightsError::Length { .. })
    ));
    let mut bytes = quantise(&spec, &tensors(&spec, &mut Random(1), 1.0))
        .as_bytes()
        .to_vec();
    bytes[0] = 25;
    let (least, most) = (0, 16);
    let expected = WeightsError::Scale {
        index: 0,
        bits: 25,
        least,
        most,
    };
    assert_eq!(QuantisedWeights::from_bytes(&spec, &bytes), Err(expected));
    let mut bytes = sample.as_bytes().to_vec();
    bytes[2] = 2;
    assert!(Sample::from_bytes(&spec.dims, &bytes)
        .unwrap_err()
        .to_string()
        .contains("frame 0 is 2"));
    bytes[0] = 14;
    assert!(Sample::from_bytes(&spec.dims, &bytes)
        .unwrap_err()
        .to_string()
        .contains("14 prefix tokens"));
}

#[test]
fn specifications_out_of_bounds_are_refused() {
    type Change = fn(&mut EvalSpec);
    let changes: [Change; 17] = [
        |spec| spec.version = 1,
        |spec| spec.dims.expert_width = 13,
        |spec| spec.dims.head_dim = 0,
        |spec| (spec.dims.heads, spec.dims.head_dim) = (130, 128),
        |spec| spec.dims.expert_width = 8194,
        |spec| spec.dims.kv_heads = 0,
        |spec| spec.dims.self_attn_every = 0,
        |spec| spec.dims.layers = 3,
        |spec| spec.dims.action_dim = 9,
        |spec| spec.dims.max_prefix = u32::MAX,
        |spec| spec.action = 13,
        |spec| spec.embedding = 15,
        |spec| spec.time_hidden = 5,
        |spec| spec.layers[1].gate = 11,
        |spec| spec.layers[0].key = 9,
        |spec| spec.rope_frequencies.truncate(1),
        |spec| spec.time_frequencies[0] = u64::MAX,
    ];
    for (index, change) in changes.iter().enumerate() {
        let mut spec = EvalSpec::micro();
        change(&mut spec);
        assert!(spec.validate().is_err(), "change {index} is accepted");
        assert!(EvalSpec::decode(&spec.encode()).is_err());
        assert!(Evaluator::new(&spec).is_err());
    }
    assert_eq!(EvalSpec::decode(&[]), Err(SpecError::Encoding));
}

#[test]
fn an_inner_node_is_not_a_leaf() {
    // With the rest of the path, the hash of an inner node leads to the root as well. Only the number of steps tells them apart.
    let leaves = leaves(8);
    let (root, path) = (merkle::root(&leaves), merkle::path(&leaves, 0).unwrap());
    let inner = merkle::node_hash(&leaves[0], &leaves[1]);
    assert!(merkle::verify(&root, 4, 0, &inner, &path[1..]));
    assert!(!merkle::verify(&root, 8, 0, &inner, &path[1..]));
}

/// A product is at most 2^30, and the largest shift of a sum is by 18 bits ([`zk0_circuits::model::linear`]).
#[test]
fn no_sum_of_a_valid_specification_leaves_int64() {
    let widest = [
        (8192, 2, 128, 128),
        (2, 16384, 128, 128),
        (8192, 16384, 64, 256),
    ];
    for (expert_width, expert_mlp, heads, head_dim) in widest {
        let dims = Dims {
            expert_width,
            expert_mlp,
            heads,
            kv_heads: heads,
            head_dim,
            ..Dims::MICRO
        };
        let spec = EvalSpec::new(dims);
        spec.validate().unwrap();
        let columns = linears(&spec).iter().map(|linear| linear.columns).max();
        let largest = (columns.unwrap() as i128) << (30 + 18);
        let bias = 1i128 << (15 + 16 + 15);
        assert!(largest + bias + i128::from(HALF) <= i128::from(i64::MAX));
    }
}
