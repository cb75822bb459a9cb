//! Openings of commitments: what was committed to is accepted, and everything else is refused.

use proptest::prelude::*;
use zk0_argument::commitment::parameters::{LAST, POSITION_WORK, SALT};
use zk0_argument::commitment::prove::columns::Column;
use zk0_argument::commitment::prove::{open, Committed, Committing, Hiding, Matrix, Message};
use zk0_argument::commitment::{verify, Parameters, Rate, Segment};
use zk0_argument::field::{Extension, Goldilocks};
use zk0_argument::hash::Digest;
use zk0_argument::multilinear::evaluate_extension;
use zk0_argument::prove::progress::silently;
use zk0_argument::transcript::{Challenges, Pads, Prover, Refused, Verifier};

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

/// What hides nothing well: elements that look random.
struct Weak(u64);

impl Hiding for Weak {
    fn elements(&self, column: usize, count: usize) -> Vec<Goldilocks> {
        values(self.0 + column as u64, count)
    }

    fn salts(&self, first: usize, count: usize) -> Vec<[Goldilocks; SALT]> {
        let salts = values(!self.0, (first + count) * SALT);
        salts[first * SALT..].as_chunks().0.to_vec()
    }
}

/// Segments with matrices of these widths. The first has two, and the others one.
fn segments(parameters: &Parameters) -> Vec<Committed> {
    let height = 1 << parameters.variables();
    let matrix = |seed: u64, width: usize, tail: usize| {
        let column = |number| Column::from(values(100 * seed + number, height));
        let tails = (0..width).map(|number| Weak(seed).elements(number, tail));
        Matrix::new((0..width as u64).map(column).collect(), tails.collect())
    };
    let longest = parameters.longest_tail();
    let mut first = Committing::new(parameters, 4);
    first.add(matrix(1, 3, parameters.positions()));
    let first = first.finish(matrix(2, 1, longest), Box::new(Weak(3)));
    let second = Committing::new(parameters, 9).finish(matrix(4, 9, longest), Box::new(Weak(5)));
    vec![first, second]
}

const WIDTHS: [&[usize]; 2] = [&[3, 1], &[9]];

fn weights(challenges: &mut impl Challenges) -> Vec<Extension> {
    challenges.challenges(WIDTHS.concat().iter().sum())
}

/// A proof, and the value of the combination.
fn proof(parameters: &Parameters) -> (Vec<u64>, Extension) {
    let mut prover = Prover::new(&STATEMENT, Pads::new(vec![]));
    let segments = segments(parameters);
    let segments: Vec<&Committed> = segments.iter().collect();
    segments.iter().for_each(|segment| segment.say(&mut prover));
    let weights = weights(&mut prover);
    let point = prover.challenges(parameters.variables());
    let message = Message::of_columns(parameters, &segments, &weights);
    let value = evaluate_extension(&message.values, &point);
    let values = segments.iter().flat_map(|segment| segment.at(&point));
    let sum = weights.iter().zip(values).map(|(&w, v)| w * v).sum();
    assert_eq!(value, sum);
    open(
        &mut prover,
        parameters,
        &segments,
        message,
        &point,
        &silently,
    );
    (prover.finish().unwrap(), value)
}

fn check(parameters: &Parameters, proof: &[u64], value: Extension) -> Result<(), Refused> {
    let mut verifier = Verifier::new(&STATEMENT, proof);
    let segments = WIDTHS.map(|widths| Segment::receive(&mut verifier, widths.to_vec()));
    let segments = segments.into_iter().collect::<Result<Vec<_>, _>>()?;
    let weights = weights(&mut verifier);
    let point = verifier.challenges(parameters.variables());
    let positions = verify(
        &mut verifier,
        parameters,
        &segments,
        &weights,
        &point,
        value,
    )?;
    assert_eq!(positions.len(), parameters.positions());
    verifier.finish()
}

/// As high as tests want it.
fn small(height: u32, rate: Rate) -> Parameters {
    Parameters::with_positions(height, rate, 1 << (height - LAST))
}

#[test]
fn a_value_at_a_point_is_shown() {
    for (height, rate) in [
        (8, Rate::Half),
        (8, Rate::Quarter),
        (10, Rate::Eighth),
        (6, Rate::Sixteenth),
    ] {
        let parameters = small(height, rate);
        let (proof, value) = proof(&parameters);
        assert_eq!(
            check(&parameters, &proof, value),
            Ok(()),
            "{height} {rate:?}"
        );
        let other = value + Extension::ONE;
        let refused = Err(Refused::Equation("the sumcheck of an opening"));
        assert_eq!(check(&parameters, &proof, other), refused);
    }
}

#[test]
fn every_word_of_a_proof_matters() {
    let parameters = small(6, Rate::Sixteenth);
    let (proof, value) = proof(&parameters);
    for place in 0..proof.len() {
        let mut changed = proof.clone();
        changed[place] ^= 1;
        assert!(
            check(&parameters, &changed, value).is_err(),
            "word {place} of {}",
            proof.len()
        );
    }
}

/// A word that is too far from all codewords passes with 2^-102.4, work included.
#[test]
fn there_are_enough_positions() {
    for (rate, length) in [
        (Rate::Half, 0.5),
        (Rate::Quarter, 0.25),
        (Rate::Eighth, 0.125),
        (Rate::Sixteenth, 0.0625),
    ] {
        let missed: f64 = (1.0 + length * (1.0 + 1.0 / 16.0)) / 2.0;
        let passes = |positions: usize| positions as f64 * missed.log2() - POSITION_WORK as f64;
        let positions = Parameters::new(12, rate).unwrap().positions();
        assert!(passes(positions) <= -102.4, "{rate:?}");
        assert!(passes(positions - 1) > -102.4, "{rate:?}");
    }
    assert_eq!((POSITION_WORK, LAST), (22, 4));
}

#[test]
fn heights_are_even_and_have_room_for_tails() {
    for (bits, height) in [(9, 16), (16, 16), (19, 20), (22, 22), (26, 22)] {
        let parameters = Parameters::of_samples(bits);
        assert_eq!(parameters.variables(), height);
        assert!(parameters.longest_tail() >= parameters.positions());
    }
    let refused = [10, 13, 26].map(|height| Parameters::new(height, Rate::Quarter));
    assert_eq!(refused, [None; 3]);
}

proptest! {
    #[test]
    fn words_that_are_no_proof_are_refused(words in prop::collection::vec(any::<u64>(), 0..3000)) {
        let parameters = small(8, Rate::Half);
        prop_assert!(check(&parameters, &words, Extension::ONE).is_err());
    }
}
