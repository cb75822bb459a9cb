//! The t-test of a claim, against statrs' distribution and against the same test in floating point.

use proptest::prelude::*;
use statrs::distribution::{ContinuousCDF, StudentsT};
use zk0_circuits::claim::student::{quantile, Confidence};
use zk0_circuits::claim::t_test::{Pair, TTest};

const LEVELS: [(Confidence, f64); 3] = [
    (Confidence::P95, 0.95),
    (Confidence::P99, 0.99),
    (Confidence::P999, 0.999),
];

/// The probability that Student's t with so many degrees of freedom is at most `t`.
fn below(t: f64, freedom: u32) -> f64 {
    StudentsT::new(0.0, 1.0, f64::from(freedom)).unwrap().cdf(t)
}

#[test]
fn quantiles_are_those_of_students_distribution_rounded_up() {
    for (confidence, level) in LEVELS {
        let mut last = u32::MAX;
        for samples in 2..=4096 {
            let found = quantile(samples, confidence).unwrap();
            let freedom = samples - 1;
            assert!(
                below(f64::from(found) / 1000.0, freedom) >= level,
                "{samples} samples at {confidence}: {found} is too small"
            );
            // Up to 31 samples the table has a row for each number.
            if samples <= 31 {
                let less = f64::from(found - 1) / 1000.0;
                assert!(below(less, freedom) < level, "{samples} at {confidence}");
            }
            assert!(found <= last, "quantiles fall");
            last = found;
        }
    }
    assert_eq!(quantile(16, Confidence::P99), Some(2603));
    assert_eq!(quantile(1, Confidence::P99), None);
    assert_eq!(quantile(0, Confidence::P99), None);
}

fn pairs(values: &[(u64, u64)]) -> Vec<Pair> {
    let pair = |&(base, update): &(u64, u64)| Pair { base, update };
    values.iter().map(pair).collect()
}

fn at(min_improvement_bps: u32, confidence: Confidence) -> TTest {
    TTest {
        min_improvement_bps,
        confidence,
    }
}

#[test]
fn edges_are_decided_and_never_overflow() {
    let test = at(100, Confidence::P99);
    let passes = |values: &[(u64, u64)]| test.passes(&pairs(values));
    assert!(!passes(&[]));
    assert!(!passes(&[(u64::MAX, 0)]), "one sample has no spread");
    assert!(passes(&[(1000, 900), (1000, 900)]), "the spread is zero");
    assert!(!passes(&[(1000, 990), (1000, 990)]), "exactly the minimum");
    assert!(!passes(&[(0, 0), (0, 0)]));
    assert!(!passes(&[(900, 1000), (900, 1000)]), "it got worse");
    assert!(passes(&vec![(u64::MAX, 0); 4096]));
    assert!(!passes(&vec![(0, u64::MAX); 4096]));
    assert!(!passes(&vec![(u64::MAX, 0); 4097]), "too many samples");
    let wild: Vec<_> = (0..4096)
        .map(|i| [(u64::MAX, 0), (0, u64::MAX - 1)][i % 2])
        .collect();
    assert!(!passes(&wild));
    // A minimum of more than all is that of all, which no loss reaches.
    assert!(!at(u32::MAX, Confidence::P95).passes(&pairs(&[(1000, 0), (1001, 0)])));
}

#[test]
fn one_good_sample_does_not_carry_the_others() {
    let lucky: Vec<_> = [(1_000_000, 1)]
        .into_iter()
        .chain([(1000, 1001); 15])
        .collect();
    assert!(!at(1, Confidence::P95).passes(&pairs(&lucky)));
    let steady: Vec<_> = (0..16).map(|i| (1000 + i, 950 + i % 3)).collect();
    assert!(at(100, Confidence::P999).passes(&pairs(&steady)));
}

/// The statistic in floating point, and the quantile that it has to exceed.
fn statistic(pairs: &[Pair], min_improvement_bps: u32) -> f64 {
    let kept = f64::from(10_000 - min_improvement_bps);
    let differences: Vec<f64> = pairs
        .iter()
        .map(|pair| kept * pair.base as f64 - 10_000.0 * pair.update as f64)
        .collect();
    let n = differences.len() as f64;
    let mean = differences.iter().sum::<f64>() / n;
    let variance = differences.iter().map(|d| (d - mean).powi(2)).sum::<f64>() / (n - 1.0);
    mean / (variance / n).sqrt()
}

proptest! {
    #[test]
    fn the_decision_is_that_of_the_formula(
        values in prop::collection::vec((1_000u64..2_000_000, 1_000u64..2_000_000), 2..200),
        better in 0u64..1_000_000,
        min_improvement_bps in 0u32..2_000,
        level in 0usize..3,
    ) {
        let (confidence, _) = LEVELS[level];
        let values: Vec<_> = values.iter().map(|&(base, update)| (base + better, update)).collect();
        let pairs = pairs(&values);
        let quantile = f64::from(quantile(pairs.len() as u32, confidence).unwrap()) / 1000.0;
        let found = statistic(&pairs, min_improvement_bps);
        // Floating point decides where it is sure.
        prop_assume!((found - quantile).abs() > 1e-6);
        prop_assert_eq!(at(min_improvement_bps, confidence).passes(&pairs), found > quantile);
    }
}
