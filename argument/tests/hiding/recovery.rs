//! What somebody does who wants a sample: every opened row is an equation about it. With four arguments there are more equations than values.

use super::made::elements;
use super::rank::{positions, solve};
use zk0_argument::commitment::prove::Encoder;
use zk0_argument::field::Goldilocks;

const HEIGHT: u32 = 12;
/// Values of a sample that are not zero.
const VALUES: usize = 200;
/// Opened by each argument.
const POSITIONS: usize = 64;
const ARGUMENTS: usize = 4;

/// What elimination finds of a sample that was committed to with a tail.
fn found(sample: &[Goldilocks], tail: &[Goldilocks]) -> Option<Vec<Goldilocks>> {
    let mut values = sample.to_vec();
    values.resize(1 << HEIGHT, Goldilocks::ZERO);
    let codeword = Encoder::new(2).encode(&values, tail);
    let generator = Goldilocks::root_of_unity(codeword.len().ilog2());
    let opened = positions(5, ARGUMENTS * POSITIONS, codeword.len());
    let rows = opened.into_iter().map(|position| {
        let point = generator.pow(position as u64);
        let powers = core::iter::successors(Some(Goldilocks::ONE), |&power| Some(power * point));
        let mut row: Vec<Goldilocks> = powers.take(VALUES).collect();
        row.push(codeword[position]);
        row
    });
    solve(rows.collect())
}

#[test]
fn elimination_finds_a_sample_without_a_tail_and_nothing_with_one() {
    let sample: Vec<Goldilocks> = elements(3, VALUES)
        .into_iter()
        .map(|value| Goldilocks::from_i64(value.value() as i16 as i64))
        .collect();
    assert_eq!(found(&sample, &[]), Some(sample.clone()));
    let tail = elements(4, ARGUMENTS * POSITIONS);
    assert_eq!(found(&sample, &tail), None);
}
