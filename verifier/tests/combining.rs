//! Combining updates is exact, and does not depend on the order they are given in.

use proptest::prelude::*;
use zk0_circuits::model::layout::TensorSpec;
use zk0_circuits::NodeId;
use zk0_verifier::combine::contributions::CombineError;
use zk0_verifier::combine::fedavg::average;
use zk0_verifier::combine::robust::{median, trimmed_mean};
use zk0_verifier::ExpertTensors;

fn specs(len: usize) -> Vec<TensorSpec> {
    vec![TensorSpec {
        name: "weight".into(),
        shape: vec![len],
    }]
}

/// Returns the weights as they arrive, which is through a file.
fn tensors(values: &[f32]) -> ExpertTensors {
    let data: Vec<u8> = values
        .iter()
        .flat_map(|value| value.to_le_bytes())
        .collect();
    let view =
        safetensors::tensor::TensorView::new(safetensors::Dtype::F32, vec![values.len()], &data);
    let file = safetensors::serialize([("weight", view.unwrap())], None).unwrap();
    ExpertTensors::read(&file, &specs(values.len())).unwrap()
}

fn node(number: u8) -> NodeId {
    NodeId([number; 32])
}

fn bits(tensors: &ExpertTensors) -> Vec<u32> {
    tensors
        .get("weight")
        .unwrap()
        .iter()
        .map(|value| value.to_bits())
        .collect()
}

#[test]
fn weights_count_by_samples() {
    let (low, high) = (tensors(&[0.0, 1.0]), tensors(&[4.0, -1.0]));
    let mean = average(&[(node(1), 3, &low), (node(2), 1, &high)]).unwrap();
    assert_eq!(mean.get("weight").unwrap(), [1.0, 0.5]);
}

#[test]
fn one_contribution_averages_to_itself() {
    let values = [
        1.0,
        -0.0,
        f32::MIN_POSITIVE,
        f32::from_bits(1),
        f32::MAX,
        f32::MIN,
        0.1,
    ];
    let alone = tensors(&values);
    let mean = average(&[(node(1), 536_870_911, &alone)]).unwrap();
    assert_eq!(bits(&mean), bits(&alone));
}

#[test]
fn rounding_happens_once_at_the_end() {
    // In float32 arithmetic, 2^24 + 1 + 1 loses both ones. With one final rounding, they count.
    let (large, one) = (tensors(&[16_777_216.0]), tensors(&[1.0]));
    let mean = average(&[(node(1), 1, &large), (node(2), 1, &one), (node(3), 1, &one)]).unwrap();
    assert_eq!(mean.get("weight").unwrap(), [5_592_406.0]);
}

#[test]
fn sums_run_in_the_order_of_nodes() {
    // In doubles, (1e30 − 1e30) + 1 is 1, and 1e30 + (−1e30 + 1) is 0. The order is part of the result, and it is the order of the
    // nodes.
    let (up, down, one) = (tensors(&[1e30]), tensors(&[-1e30]), tensors(&[3.0]));
    for order in [[0, 1, 2], [2, 1, 0], [1, 2, 0], [0, 2, 1]] {
        let all = [(node(1), 1, &up), (node(2), 1, &down), (node(3), 1, &one)];
        let mean = average(&order.map(|at| all[at])).unwrap();
        assert_eq!(mean.get("weight").unwrap(), [1.0]);
    }
    let mean = average(&[(node(1), 1, &up), (node(2), 1, &one), (node(3), 1, &down)]).unwrap();
    assert_eq!(mean.get("weight").unwrap(), [0.0]);
}

#[test]
fn what_cannot_be_averaged_is_named() {
    let (short, long) = (tensors(&[1.0]), tensors(&[1.0, 2.0]));
    assert_eq!(average(&[]).unwrap_err(), CombineError::Empty);
    assert_eq!(
        average(&[(node(1), 0, &short)]).unwrap_err(),
        CombineError::Empty
    );
    let twice = average(&[
        (node(1), 1, &short),
        (node(2), 1, &short),
        (node(1), 1, &short),
    ]);
    assert_eq!(twice.unwrap_err(), CombineError::Twice(node(1)));
    let unlike = average(&[(node(1), 1, &long), (node(2), 1, &short)]);
    assert!(matches!(unlike.unwrap_err(), CombineError::Unlike { node: at, .. } if at == node(2)));
}

#[test]
fn the_average_has_the_bits_it_always_had() {
    // These bits are a test vector that was computed once. They change with any change of order, precision or rounding.
    let parts: Vec<_> = (0..5u8)
        .map(|part| {
            let value = |at: u32| ((at * 31 + u32::from(part) * 17) % 101) as f32 / 7.0 - 6.3;
            (
                node(part),
                u64::from(part) * 13 + 1,
                tensors(&(0..64).map(value).collect::<Vec<_>>()),
            )
        })
        .collect();
    let weighted: Vec<_> = parts
        .iter()
        .map(|(node, samples, part)| (*node, *samples, part))
        .collect();
    let digest = zk0_verifier::blob_digest(&average(&weighted).unwrap().to_bytes());
    assert_eq!(
        digest.to_string(),
        include_str!("vectors/fedavg.sha256").trim()
    );
}

proptest! {
    #[test]
    fn the_order_of_input_does_not_matter(
        parts in proptest::collection::vec((1u64..1 << 40, proptest::collection::vec(-1e30f32..1e30, 5)), 1..7),
        turn in any::<usize>(),
    ) {
        let parts: Vec<_> = parts.iter().enumerate()
            .map(|(at, (samples, values))| (node(at as u8), *samples, tensors(values)))
            .collect();
        let mut weighted: Vec<_> = parts.iter().map(|(node, samples, part)| (*node, *samples, part)).collect();
        let straight = average(&weighted).unwrap();
        weighted.reverse();
        prop_assert_eq!(bits(&average(&weighted).unwrap()), bits(&straight));
        let len = weighted.len();
        weighted.rotate_left(turn % len);
        prop_assert_eq!(bits(&average(&weighted).unwrap()), bits(&straight));
    }

    #[test]
    fn an_average_lies_between_its_parts(
        parts in proptest::collection::vec((1u64..1_000_000, any::<f32>().prop_filter("finite", |x| x.is_finite())), 1..6),
    ) {
        let all: Vec<_> = parts.iter().enumerate()
            .map(|(at, (samples, value))| (node(at as u8), *samples, tensors(&[*value])))
            .collect();
        let weighted: Vec<_> = all.iter().map(|(node, samples, part)| (*node, *samples, part)).collect();
        let mean = average(&weighted).unwrap().get("weight").unwrap()[0];
        let least = parts.iter().map(|(_, value)| *value).fold(f32::INFINITY, f32::min);
        let most = parts.iter().map(|(_, value)| *value).fold(f32::NEG_INFINITY, f32::max);
        prop_assert!(least <= mean && mean <= most);
    }
}

#[test]
fn a_median_is_what_most_say() {
    let given = [1.0, 2.0, 1e30, -5.0, 3.0].map(|value| tensors(&[value, -value]));
    let of = |count: usize| {
        let given: Vec<_> = given[..count]
            .iter()
            .zip(1..)
            .map(|(tensors, number)| (node(number), 1 << number, tensors))
            .collect();
        median(&given).unwrap().get("weight").unwrap().to_vec()
    };
    assert_eq!(of(1), [1.0, -1.0]);
    assert_eq!(of(2), [1.5, -1.5]);
    assert_eq!(of(3), [2.0, -2.0]);
    assert_eq!(of(5), [2.0, -2.0], "neither 1e30 nor the weights move it");
    assert_eq!(median(&[]).unwrap_err(), CombineError::Empty);
}

#[test]
fn a_trimmed_mean_leaves_out_either_end() {
    let given = [4.0, -100.0, 2.0, 100.0, 3.0].map(|value| tensors(&[value]));
    let given: Vec<_> = given
        .iter()
        .zip(1..)
        .map(|(tensors, number)| (node(number), 1, tensors))
        .collect();
    let of = |bps| trimmed_mean(&given, bps).unwrap().get("weight").unwrap()[0];
    assert_eq!(of(2000), 3.0, "(2 + 3 + 4) / 3");
    assert_eq!(
        of(1999),
        9.0 / 5.0,
        "a fifth less is nobody: the mean of all"
    );
    assert_eq!(of(4000), 3.0, "the middle alone");
    let twice = [given[0], given[0]];
    assert_eq!(
        trimmed_mean(&twice, 0).unwrap_err(),
        CombineError::Twice(node(1))
    );
}

proptest! {
    #[test]
    fn robust_averages_do_not_depend_on_order(
        values in prop::collection::vec((-1e30f32..1e30, -1e-3f32..1e-3), 1..9),
        rotate in any::<prop::sample::Index>(),
        trim_bps in 0..5000u32,
    ) {
        let given: Vec<_> = values.iter().map(|(a, b)| tensors(&[*a, *b])).collect();
        let mut given: Vec<_> = given.iter().zip(1..).map(|(tensors, number)| (node(number), 1, tensors)).collect();
        let (first, second) = (median(&given).unwrap(), trimmed_mean(&given, trim_bps).unwrap());
        let by = rotate.index(given.len());
        given.rotate_left(by);
        prop_assert_eq!(bits(&median(&given).unwrap()), bits(&first));
        prop_assert_eq!(bits(&trimmed_mean(&given, trim_bps).unwrap()), bits(&second));
        // The result is between the smallest and the largest value.
        for mean in [&first, &second] {
            let found = mean.get("weight").unwrap()[0];
            prop_assert!(values.iter().any(|(a, _)| *a <= found) && values.iter().any(|(a, _)| *a >= found));
        }
    }
}
