//! Openings of commitments: what was committed to is accepted, and everything else is refused.

use proptest::prelude::*;
use zk0_argument::commitment::prove::{open, Committed};
use zk0_argument::commitment::{verify, Parameters, Rate, Segment};
use zk0_argument::field::{Extension, Goldilocks};
use zk0_argument::hash::Digest;
use zk0_argument::multilinear::evaluate;
use zk0_argument::prove::progress::silently;
use zk0_argument::transcript::{Challenges, Prover, Refused, Verifier};

const STATEMENT: Digest = Digest([1, 2, 3, 4]);

/// Values that look random.
fn values(seed: u64, count: usize) -> Vec<Goldilocks> {
    let mut state = seed;
    let next = |_| {
        state = state
            .wrapping_mul(6364136223846793005)
            .wrapping_add(1442695040888963407);
        Goldilocks::from_i64((state >> 1) as i64)
    };
    (0..count).map(next).collect()
}

/// A proof for segments of these widths, and the values of all columns at the point.
fn proof(parameters: &Parameters, widths: &[usize]) -> (Vec<u64>, Vec<Extension>) {
    let mut prover = Prover::new(&STATEMENT);
    let mut columns = vec![];
    let mut segments = vec![];
    for &width in widths {
        let rows = values(width as u64, width << parameters.variables());
        columns.extend((0..width).map(|column| {
            rows.iter()
                .skip(column)
                .step_by(width)
                .copied()
                .collect::<Vec<_>>()
        }));
        segments.push(Committed::new(&mut prover, parameters, rows, width));
    }
    let point = prover.challenges(parameters.variables());
    let opened = open(
        &mut prover,
        parameters,
        &segments.iter().collect::<Vec<_>>(),
        &point,
        &silently,
    );
    let expected: Vec<_> = columns
        .iter()
        .map(|column| evaluate(column, &point))
        .collect();
    assert_eq!(opened, expected);
    (prover.finish(), opened)
}

fn check(
    parameters: &Parameters,
    widths: &[usize],
    proof: &[u64],
) -> Result<Vec<Extension>, Refused> {
    let mut verifier = Verifier::new(&STATEMENT, proof);
    let segments: Result<Vec<_>, _> = widths
        .iter()
        .map(|&width| Segment::receive(&mut verifier, width))
        .collect();
    let point = verifier.challenges(parameters.variables());
    let values = verify(&mut verifier, parameters, &segments?, &point)?.to_vec();
    verifier.finish()?;
    Ok(values)
}

#[test]
fn values_at_a_point_are_shown() {
    for (height, rate) in [
        (8, Rate::Half),
        (9, Rate::Quarter),
        (10, Rate::Eighth),
        (11, Rate::Sixteenth),
    ] {
        let parameters = Parameters::new(height, rate).unwrap();
        let (proof, values) = proof(&parameters, &[3, 1, 5]);
        assert_eq!(
            check(&parameters, &[3, 1, 5], &proof),
            Ok(values),
            "{height} {rate:?}"
        );
    }
}

#[test]
fn every_word_of_a_proof_matters() {
    let parameters = Parameters::new(8, Rate::Sixteenth).unwrap();
    let widths = [2, 1];
    let (proof, _) = proof(&parameters, &widths);
    for place in 0..proof.len() {
        let mut changed = proof.clone();
        changed[place] ^= 1;
        assert!(
            check(&parameters, &widths, &changed).is_err(),
            "word {place} of {}",
            proof.len()
        );
    }
}

proptest! {
    #[test]
    fn words_that_are_no_proof_are_refused(words in prop::collection::vec(any::<u64>(), 0..3000)) {
        let parameters = Parameters::new(8, Rate::Half).unwrap();
        prop_assert!(check(&parameters, &[2], &words).is_err());
    }
}
