//! Combining updates is exact, and does not depend on the order they are given in.

mod made;

use proptest::prelude::*;
use zk0_circuits::{EvalSpec, NodeId, QuantisedWeights};
use zk0_protocol::rules::network_rules::Strategy;
use zk0_verifier::blob_digest;
use zk0_verifier::combine::contributions::{CombineError, Fractions, Part};
use zk0_verifier::combine::fedavg::average;
use zk0_verifier::combine::robust::{median, trimmed_mean};
use zk0_verifier::combine::strategy::combined;
use zk0_weights::scale::{check, exact, narrowed};
use zk0_weights::{Format, Tensor, Unread};

/// Wide enough for all that is tested here, and the widest that a specification can have.
const LIMITS: (i16, i16) = (0, 24);

fn part(weight: u64, tensor: &Tensor) -> Part<'_> {
    Part {
        weight,
        values: &tensor.values,
        bits: tensor.bits,
    }
}

/// The tensor of these numbers, at its own scale.
fn tensor(numbers: &[f64]) -> Tensor {
    let numerators: Vec<_> = numbers
        .iter()
        .map(|number| (number * f64::from(1 << 24)) as i128)
        .collect();
    narrowed(&numerators, 1, LIMITS)
}

fn numbers(fractions: Fractions) -> Vec<f64> {
    let Tensor { values, bits } = narrowed(&fractions.numerators, fractions.divisor, LIMITS);
    assert_eq!(check("mean", &values, bits, LIMITS), Ok(()));
    let unit = f64::from(1 << bits);
    values
        .iter()
        .map(|value| f64::from(*value) / unit)
        .collect()
}

#[test]
fn weights_count_by_samples() {
    let (low, high) = (tensor(&[0.0, 1.0]), tensor(&[4.0, -1.0]));
    assert_ne!(low.bits, high.bits);
    let mean = average(&[part(3, &low), part(1, &high)]).unwrap();
    assert_eq!(numbers(mean), [1.0, 0.5]);
}

#[test]
fn one_contribution_averages_to_itself() {
    for (values, bits) in [
        (vec![32767, -32767, 0, 1], 7),
        (vec![16384, 3], 23),
        (vec![0, -1], 24),
    ] {
        let alone = Tensor { values, bits };
        let Fractions {
            numerators,
            divisor,
        } = average(&[part(u64::MAX, &alone)]).unwrap();
        assert_eq!(narrowed(&numerators, divisor, LIMITS), alone);
    }
}

#[test]
fn a_mean_is_rounded_once_and_ties_go_to_even() {
    // These are steps of the finest scale, so that a mean between two steps has to be rounded.
    let step = |value: i16| Tensor {
        values: vec![value],
        bits: 24,
    };
    let mean = |values: &[i16]| {
        let tensors: Vec<_> = values.iter().map(|value| step(*value)).collect();
        let parts: Vec<_> = tensors.iter().map(|tensor| part(1, tensor)).collect();
        let mean = average(&parts).unwrap();
        narrowed(&mean.numerators, mean.divisor, LIMITS).values[0]
    };
    assert_eq!(mean(&[1, 1, 2]), 1);
    assert_eq!(mean(&[1, 2, 2]), 2);
    assert_eq!(mean(&[1, 2]), 2);
    assert_eq!(mean(&[2, 3]), 2);
    assert_eq!(mean(&[-1, -2]), -2);
    assert_eq!(mean(&[-2, -3]), -2);
}

/// Weights as large as a scale's limit allows average to weights that it allows.
#[test]
fn a_mean_of_values_within_the_limits_is_within_them() {
    let limits = (3, 9);
    let largest = |sign: i16| Tensor {
        values: vec![sign * 32767, 32767],
        bits: 3,
    };
    let (up, down) = (largest(1), largest(-1));
    for parts in [
        vec![part(1, &up)],
        vec![part(u64::MAX, &up), part(u64::MAX, &up), part(1, &up)],
        vec![part(u64::MAX, &up), part(1, &down)],
    ] {
        for mean in [average(&parts), median(&parts), trimmed_mean(&parts, 100)] {
            let mean = mean.unwrap();
            let tensor = narrowed(&mean.numerators, mean.divisor, limits);
            assert_eq!(check("mean", &tensor.values, tensor.bits, limits), Ok(()));
            assert_eq!((tensor.bits, tensor.values[1]), (3, 32767));
        }
    }
}

#[test]
fn a_median_is_what_most_say() {
    let given = [1.0, 2.0, 30000.0, -5.0, 3.0].map(|value| tensor(&[value, -value]));
    let of = |count: usize| {
        let parts: Vec<_> = given[..count]
            .iter()
            .zip(1..)
            .map(|(tensor, number)| part(1 << number, tensor))
            .collect();
        numbers(median(&parts).unwrap())
    };
    assert_eq!(of(1), [1.0, -1.0]);
    assert_eq!(of(2), [1.5, -1.5]);
    assert_eq!(of(3), [2.0, -2.0]);
    assert_eq!(of(5), [2.0, -2.0], "neither 30000 nor the weights move it");
    assert_eq!(median(&[]).unwrap_err(), CombineError::Empty);
}

#[test]
fn a_trimmed_mean_leaves_out_either_end() {
    let given = [4.0, -100.0, 2.0, 100.0, 3.0].map(|value| tensor(&[value]));
    let parts: Vec<_> = given.iter().map(|tensor| part(1, tensor)).collect();
    let of = |bps| numbers(trimmed_mean(&parts, bps).unwrap())[0];
    assert_eq!(of(2000), 3.0, "(2 + 3 + 4) / 3");
    let all = of(1999);
    assert!(
        (all - 9.0 / 5.0).abs() < 1e-4,
        "a fifth less is nobody: the mean of all is {all}"
    );
    assert_eq!(of(4000), 3.0, "the middle alone");
}

fn node(number: u8) -> NodeId {
    NodeId([number; 32])
}

fn micro() -> (EvalSpec, Format, Unread) {
    let spec = EvalSpec::micro();
    let format = made::format(&spec);
    let base = made::file(&spec, &made::tensors(&spec, 0, 1.0));
    let unread = Unread::of(&format, &format.open(&base[..]).unwrap()).unwrap();
    (spec, format, unread)
}

const STRATEGIES: [Strategy; 3] = [
    Strategy::FedAvg,
    Strategy::Median,
    Strategy::TrimmedMean { trim_bps: 2500 },
];

/// Five updates with their nodes and weights.
fn five(spec: &EvalSpec) -> Vec<(NodeId, u64, QuantisedWeights)> {
    (0..5u8)
        .map(|part| {
            let tensors = made::tensors(spec, part.into(), 0.5 + f32::from(part));
            let weight = u64::from(part) * 13 + 1;
            (node(part), weight, made::quantise(spec, &tensors))
        })
        .collect()
}

#[test]
fn what_cannot_be_combined_is_named() {
    let (spec, format, unread) = micro();
    let all = five(&spec);
    let one = |number: usize, weight: u64| (all[number].0, weight, &all[number].2);
    for strategy in STRATEGIES {
        let refused = |given: &[_]| combined(&format, given, strategy, &unread).unwrap_err();
        assert_eq!(refused(&[]), CombineError::Empty);
        let twice = [one(1, 1), one(2, 1), one(1, 1)];
        assert_eq!(refused(&twice), CombineError::Twice(node(1)));
        let mut dims = spec.dims;
        dims.expert_mlp += 2;
        let other = EvalSpec::new(dims);
        let other = made::quantise(&other, &made::tensors(&other, 1, 1.0));
        let unlike = [one(1, 1), (node(7), 1, &other)];
        assert_eq!(refused(&unlike), CombineError::Unlike(node(7)));
    }
    let weightless = [one(1, 0)];
    let refused = combined(&format, &weightless, Strategy::FedAvg, &unread);
    assert_eq!(refused.unwrap_err(), CombineError::Empty);
}

#[test]
fn the_order_of_contributions_does_not_matter() {
    let (spec, format, unread) = micro();
    let all = five(&spec);
    let mut given: Vec<_> = all
        .iter()
        .map(|(node, weight, one)| (*node, *weight, one))
        .collect();
    for strategy in STRATEGIES {
        let straight = combined(&format, &given, strategy, &unread).unwrap();
        for turn in 0..5 {
            given.rotate_left(1);
            given.swap(0, turn);
            let turned = combined(&format, &given, strategy, &unread).unwrap();
            assert!(turned == straight);
        }
        // It is a file that the next round can begin with.
        assert_eq!(format.read(&format.write(&straight)), Ok(straight));
    }
}

#[test]
fn results_have_the_bits_they_always_had() {
    // This is a test vector that was computed once. It changes with any change of the arithmetic, and so would all ledgers.
    let (spec, format, unread) = micro();
    let all = five(&spec);
    let given: Vec<_> = all
        .iter()
        .map(|(node, weight, one)| (*node, *weight, one))
        .collect();
    let digests = STRATEGIES.map(|strategy| {
        let result = combined(&format, &given, strategy, &unread).unwrap();
        format!("{}\n", blob_digest(&format.write(&result)))
    });
    assert_eq!(digests.concat(), include_str!("vectors/combined.sha256"));
}

proptest! {
    /// Each result is the nearest number at its scale, and lies between the least and the greatest value.
    #[test]
    fn means_are_the_nearest_numbers_between_their_parts(
        parts in prop::collection::vec((any::<u64>(), any::<i16>(), 0i16..=24), 1..9),
        trim_bps in 0..5000u32,
    ) {
        let tensors: Vec<_> = parts.iter().map(|(_, value, bits)| {
            narrowed(&[exact((*value).max(-i16::MAX), *bits).into()], 1, LIMITS)
        }).collect();
        let parts: Vec<_> = tensors.iter().zip(&parts).map(|(tensor, (weight, _, _))| part((*weight).max(1), tensor)).collect();
        let values = tensors.iter().map(|one| i128::from(exact(one.values[0], one.bits)));
        let (least, most) = (values.clone().min().unwrap(), values.max().unwrap());
        for mean in [average(&parts), median(&parts), trimmed_mean(&parts, trim_bps)] {
            let Fractions { numerators, divisor } = mean.unwrap();
            prop_assert!(least * divisor <= numerators[0] && numerators[0] <= most * divisor);
            let tensor = narrowed(&numerators, divisor, LIMITS);
            prop_assert_eq!(check("mean", &tensor.values, tensor.bits, LIMITS), Ok(()));
            let found = i128::from(exact(tensor.values[0], tensor.bits)) * divisor;
            let step = i128::from(exact(1, tensor.bits)) * divisor;
            prop_assert!(2 * (found - numerators[0]).abs() <= step);
        }
    }
}
