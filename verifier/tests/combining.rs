//! Combining updates is exact, and does not depend on the order they are given in.

use crate::made::{self, OneTensor, STRATEGIES};
use proptest::prelude::*;
use zk0_circuits::{EvalSpec, Mode, NodeId, QuantisedWeights};
use zk0_protocol::rules::network_rules::{Scaffold, Strategy};
use zk0_verifier::combine::bases::Bases;
use zk0_verifier::combine::blocks::Combination;
use zk0_verifier::combine::contributions::WeightedContribution;
use zk0_verifier::combine::error::CombineError;
use zk0_verifier::combine::fedavg::average;
use zk0_verifier::combine::robust::{median, trimmed_mean};
use zk0_verifier::combine::source::WeightsInMemory;
use zk0_verifier::{blob_digest, Evaluation};
use zk0_weights::rounding::Unit;
use zk0_weights::scale::{check, exact, narrowed};
use zk0_weights::{Format, ScaledTensor, Unread};

/// Wide enough for all that is tested here, and the widest that a specification can have.
const LIMITS: (i16, i16) = (0, 24);

/// Contributions of one tensor each.
fn given<'a>(tensors: &'a [OneTensor], weights: &[u64]) -> Vec<WeightedContribution<'a>> {
    let pairs = tensors.iter().zip(weights).zip(0..);
    let given = pairs.map(|((tensor, weight), number)| WeightedContribution {
        node: node(number),
        weight: *weight,
        weights: tensor,
    });
    given.collect()
}

/// The tensor of these numbers, at its own scale.
fn tensor(numbers: &[f64]) -> OneTensor {
    let numerators: Vec<_> = numbers
        .iter()
        .map(|number| (number * f64::from(1 << 24)) as i128)
        .collect();
    OneTensor(narrowed(&numerators, 1, LIMITS))
}

/// The exact numbers of the one tensor, and what they stand for.
fn exactly(combination: &impl Combination, len: usize) -> (Vec<i128>, Unit) {
    let (plan, numbers) = made::exact_numbers(combination, len);
    let largest = numbers.iter().map(|one| one.unsigned_abs()).max();
    assert!(largest <= Some(plan.bound), "beyond what was planned");
    (numbers, plan.unit)
}

/// The rounded tensor.
fn rounded(combination: &impl Combination, len: usize, limits: (i16, i16)) -> ScaledTensor {
    let (numbers, unit) = exactly(combination, len);
    made::rounded_to(&numbers, unit, limits)
}

fn numbers(combination: &impl Combination, len: usize) -> Vec<f64> {
    let ScaledTensor { values, bits } = rounded(combination, len, LIMITS);
    assert_eq!(check("mean", &values, bits, LIMITS), Ok(()));
    let unit = f64::from(1 << bits);
    values
        .iter()
        .map(|value| f64::from(*value) / unit)
        .collect()
}

#[test]
fn weights_count_by_samples() {
    let tensors = [tensor(&[0.0, 1.0]), tensor(&[4.0, -1.0])];
    assert_ne!(tensors[0].0.bits, tensors[1].0.bits);
    let mean = average(&given(&tensors, &[3, 1])).unwrap();
    assert_eq!(numbers(&mean, 2), [1.0, 0.5]);
}

#[test]
fn one_contribution_averages_to_itself() {
    for (values, bits) in [
        (vec![32767, -32767, 0, 1], 7),
        (vec![16384, 3], 23),
        (vec![0, -1], 24),
    ] {
        let alone = [OneTensor(ScaledTensor { values, bits })];
        let len = alone[0].0.values.len();
        let mean = average(&given(&alone, &[u64::MAX])).unwrap();
        assert_eq!(rounded(&mean, len, LIMITS), alone[0].0);
    }
}

#[test]
fn a_mean_is_rounded_once_and_ties_go_to_even() {
    // These are steps of the finest scale, so that a mean between two steps has to be rounded.
    let step = |value: &i16| {
        OneTensor(ScaledTensor {
            values: vec![*value],
            bits: 24,
        })
    };
    let mean = |values: &[i16]| {
        let tensors: Vec<_> = values.iter().map(step).collect();
        let mean = average(&given(&tensors, &[1; 9])).unwrap();
        rounded(&mean, 1, LIMITS).values[0]
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
    let largest = |sign: i16| {
        OneTensor(ScaledTensor {
            values: vec![sign * 32767, 32767],
            bits: 3,
        })
    };
    for (signs, weights) in [
        (&[1][..], &[1][..]),
        (&[1, 1, 1], &[u64::MAX, u64::MAX, 1]),
        (&[1, -1], &[u64::MAX, 1]),
    ] {
        let tensors: Vec<_> = signs.iter().map(|sign| largest(*sign)).collect();
        let given = given(&tensors, weights);
        for tensor in [
            rounded(&average(&given).unwrap(), 2, limits),
            rounded(&median(&given), 2, limits),
            rounded(&trimmed_mean(&given, 100), 2, limits),
        ] {
            assert_eq!(check("mean", &tensor.values, tensor.bits, limits), Ok(()));
            assert_eq!((tensor.bits, tensor.values[1]), (3, 32767));
        }
    }
}

#[test]
fn a_median_is_what_most_say() {
    let tensors = [1.0, 2.0, 30000.0, -5.0, 3.0].map(|value| tensor(&[value, -value]));
    let of = |count: usize| {
        let given = given(&tensors[..count], &[2, 4, 8, 16, 32]);
        numbers(&median(&given), 2)
    };
    assert_eq!(of(1), [1.0, -1.0]);
    assert_eq!(of(2), [1.5, -1.5]);
    assert_eq!(of(3), [2.0, -2.0]);
    assert_eq!(of(5), [2.0, -2.0], "neither 30000 nor the weights move it");
}

#[test]
fn a_trimmed_mean_leaves_out_either_end() {
    let tensors = [4.0, -100.0, 2.0, 100.0, 3.0].map(|value| tensor(&[value]));
    let given = given(&tensors, &[1; 5]);
    let of = |bps| numbers(&trimmed_mean(&given, bps), 1)[0];
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

fn micro() -> (EvalSpec, Format, Unread, Bases) {
    let spec = EvalSpec::micro();
    let format = made::format(&spec);
    let base = made::file(&spec, &made::tensors(&spec, 0, 1.0));
    let unread = Unread::of(&format, &format.open(&base[..]).unwrap()).unwrap();
    let bases = Bases {
        base: Some(format.read(&base).unwrap()),
        earlier: Some(made::quantise(&spec, &made::tensors(&spec, 9, 0.7))),
    };
    (spec, format, unread, bases)
}

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

fn in_memory<'a>(
    format: &'a Format,
    all: &'a [(NodeId, u64, QuantisedWeights)],
) -> Vec<WeightsInMemory<'a>> {
    let weights = all.iter().map(|(_, _, weights)| weights);
    weights
        .map(|weights| WeightsInMemory { format, weights })
        .collect()
}

fn one<'a>(
    of: &(NodeId, u64, QuantisedWeights),
    weights: &'a WeightsInMemory<'a>,
) -> WeightedContribution<'a> {
    WeightedContribution {
        node: of.0,
        weight: of.1,
        weights,
    }
}

#[test]
fn what_cannot_be_combined_is_named() {
    let (spec, format, unread, bases) = micro();
    let all = five(&spec);
    let weights = in_memory(&format, &all);
    let one = |number: usize| one(&all[number], &weights[number]);
    let mut dims = spec.dims;
    dims.expert_mlp += 2;
    let other_spec = EvalSpec::new(dims);
    let other_format = made::format(&other_spec);
    let other = made::quantise(&other_spec, &made::tensors(&other_spec, 1, 1.0));
    let other = WeightsInMemory {
        format: &other_format,
        weights: &other,
    };
    for strategy in STRATEGIES {
        let refused =
            |given: &[_]| made::combine(&format, given, strategy, &bases, &unread).unwrap_err();
        assert_eq!(refused(&[]), CombineError::Empty);
        assert_eq!(
            refused(&[one(1), one(2), one(1)]),
            CombineError::Twice(node(1))
        );
        let unlike = WeightedContribution {
            node: node(7),
            weight: 1,
            weights: &other,
        };
        assert_eq!(refused(&[one(1), unlike]), CombineError::Unlike(node(7)));
    }
    let weightless = [WeightedContribution {
        weight: 0,
        ..one(1)
    }];
    let refused = |strategy, bases: &Bases| {
        made::combine(&format, &weightless, strategy, bases, &unread).unwrap_err()
    };
    let [.., clipping, momentum, adam] = STRATEGIES;
    for strategy in [Strategy::FedAvg, clipping, momentum, adam] {
        assert_eq!(refused(strategy, &bases), CombineError::Empty);
    }
    for strategy in [clipping, momentum, adam] {
        let refused = refused(strategy, &Bases::default());
        assert_eq!(refused, CombineError::NoBase);
    }
}

#[test]
fn the_order_of_contributions_does_not_matter() {
    let (spec, format, unread, bases) = micro();
    let all = five(&spec);
    let weights = in_memory(&format, &all);
    let given = all.iter().zip(&weights);
    let mut given: Vec<_> = given.map(|(of, weights)| one(of, weights)).collect();
    for strategy in STRATEGIES {
        let straight = made::combine(&format, &given, strategy, &bases, &unread).unwrap();
        for turn in 0..5 {
            given.rotate_left(1);
            given.swap(0, turn);
            let turned = made::combine(&format, &given, strategy, &bases, &unread).unwrap();
            assert!(turned == straight);
        }
        // It is a file that the next round can begin with.
        let read = format.read(straight.bytes()).unwrap();
        assert!(format.write(&read) == straight.bytes());
        // Its digests are those of every other file of weights.
        for mode in [Mode::Direct, Mode::Succinct] {
            let evaluation = Evaluation::new(&spec, mode).unwrap();
            let digest = evaluation.digest(straight.bytes(), &read);
            assert_eq!(evaluation.digest_of(&straight), Ok(digest));
        }
        assert_eq!(straight.weights(&spec), Ok(read));
        assert!(straight.clone().into_bytes() == straight.bytes());
    }
}

/// The control variates of SCAFFOLD follow from the bases only if the mean has equal weights.
#[test]
fn contributions_by_scaffold_count_alike() {
    let (spec, format, unread, bases) = micro();
    let all = five(&spec);
    let weights = in_memory(&format, &all);
    let given = all.iter().zip(&weights);
    let given: Vec<_> = given.map(|(of, weights)| one(of, weights)).collect();
    let alike: Vec<_> = given
        .iter()
        .map(|one| WeightedContribution { weight: 1, ..*one })
        .collect();
    let scaffold = Strategy::Scaffold(Scaffold {
        steps: 10,
        learning_rate_millionths: 1000,
        restart_rounds: 5,
    });
    let combine =
        |given: &[_], strategy| made::combine(&format, given, strategy, &bases, &unread).unwrap();
    let result = combine(&given, scaffold);
    assert!(result == combine(&alike, Strategy::FedAvg));
    assert!(result != combine(&given, Strategy::FedAvg));
}

#[test]
fn results_have_the_bits_they_always_had() {
    // This is a test vector that was computed once. It changes with any change of the arithmetic, and so would all ledgers.
    let (spec, format, unread, bases) = micro();
    let all = five(&spec);
    let weights = in_memory(&format, &all);
    let given = all.iter().zip(&weights);
    let given: Vec<_> = given.map(|(of, weights)| one(of, weights)).collect();
    let digests = STRATEGIES.map(|strategy| {
        let result = made::combine(&format, &given, strategy, &bases, &unread).unwrap();
        format!("{}\n", blob_digest(result.bytes()))
    });
    made::check_vector("combined", &digests.concat());
}

proptest! {
    /// Each result is the nearest number at its scale, and lies between the least and the greatest value.
    #[test]
    fn means_are_the_nearest_numbers_between_their_parts(
        parts in prop::collection::vec((any::<u64>(), any::<i16>(), 0i16..=24), 1..9),
        trim_bps in 0..5000u32,
    ) {
        let tensors: Vec<_> = parts.iter().map(|(_, value, bits)| {
            OneTensor(narrowed(&[exact((*value).max(-i16::MAX), *bits).into()], 1, LIMITS))
        }).collect();
        let weights: Vec<_> = parts.iter().map(|(weight, _, _)| (*weight).max(1)).collect();
        let given = given(&tensors, &weights);
        let values = tensors.iter().map(|one| i128::from(exact(one.0.values[0], one.0.bits)));
        let (least, most) = (values.clone().min().unwrap(), values.max().unwrap());
        for (numbers, unit) in [
            exactly(&average(&given).unwrap(), 1),
            exactly(&median(&given), 1),
            exactly(&trimmed_mean(&given, trim_bps), 1),
        ] {
            let (divisor, number) = (unit.divisor, numbers[0] << (24 - unit.bits));
            prop_assert!(least * divisor <= number && number <= most * divisor);
            let tensor = made::rounded_to(&numbers, unit, LIMITS);
            prop_assert_eq!(check("mean", &tensor.values, tensor.bits, LIMITS), Ok(()));
            let found = i128::from(exact(tensor.values[0], tensor.bits)) * divisor;
            let step = i128::from(exact(1, tensor.bits)) * divisor;
            prop_assert!(2 * (found - number).abs() <= step);
        }
    }
}
