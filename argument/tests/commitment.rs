//! Openings of commitments: what was committed to is accepted, and everything else is refused.

use proptest::prelude::*;
use zk0_argument::commitment::parameters::{CAP, LAST, POSITION_WORK, SALT};
use zk0_argument::commitment::prove::columns::Column;
use zk0_argument::commitment::prove::{
    open, CodeMatrix, CommittedSegment, Committing, Hiding, Message,
};
use zk0_argument::commitment::{verify, Parameters, Rate, Segment};
use zk0_argument::field::{Extension, Goldilocks};
use zk0_argument::hash::SpongeDigest;
use zk0_argument::multilinear::{eq_table, evaluate_extension};
use zk0_argument::prove::progress::silently;
use zk0_argument::transcript::{Challenges, Pads, Prover, Refused, Verifier};

const STATEMENT: SpongeDigest = SpongeDigest([1, 2, 3, 4]);

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
fn segments(parameters: &Parameters, world: u64) -> Vec<CommittedSegment> {
    let height = 1 << parameters.variables();
    let matrix = |seed: u64, width: usize, tail: usize| {
        let column = |number| Column::from(values(1000 * world + 100 * seed + number, height));
        let tails = (0..width).map(|number| Weak(seed).elements(number, tail));
        CodeMatrix::new((0..width as u64).map(column).collect(), tails.collect())
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

/// A prover that commits to world 0, combines the columns of one world and opens the rows of another. Returns what it states, and the value of the
/// combination.
fn argued(
    parameters: &Parameters,
    combined: u64,
    opened: u64,
    deaf: bool,
) -> (Vec<u64>, Extension) {
    let mut prover = Prover::new(&STATEMENT, Pads::new(vec![]));
    if deaf {
        prover = prover.deaf();
    }
    let [said, combined, opened] = [0, combined, opened].map(|world| segments(parameters, world));
    said.iter().for_each(|segment| segment.say(&mut prover));
    let weights = weights(&mut prover);
    let point = prover.challenges(parameters.variables());
    let [combined, opened] = [&combined, &opened].map(|all| all.iter().collect::<Vec<_>>());
    let message = Message::of_columns(parameters, &combined, &weights);
    let value = evaluate_extension(&message.values, &point);
    let values = combined.iter().flat_map(|segment| segment.at(&point));
    let sum = weights.iter().zip(values).map(|(&w, v)| w * v).sum();
    assert_eq!(value, sum);
    open(&mut prover, parameters, &opened, message, &point, &silently);
    (prover.finish().unwrap(), value)
}

/// An honest proof, and the value of the combination.
fn proof(parameters: &Parameters) -> (Vec<u64>, Extension) {
    argued(parameters, 0, 0, false)
}

fn check(parameters: &Parameters, proof: &[u64], value: Extension) -> Result<(), Refused> {
    check_with(parameters, Verifier::new(&STATEMENT, proof), value)
}

fn check_with(
    parameters: &Parameters,
    mut verifier: Verifier<'_>,
    value: Extension,
) -> Result<(), Refused> {
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
fn a_combination_of_other_columns_is_refused() {
    let parameters = small(8, Rate::Half);
    let (proof, value) = argued(&parameters, 1, 0, false);
    let refused = Err(Refused::Equation("a fold of an opening"));
    assert_eq!(check(&parameters, &proof, value), refused);
}

#[test]
fn rows_of_other_columns_are_refused() {
    let parameters = small(8, Rate::Half);
    let (proof, value) = argued(&parameters, 1, 1, false);
    assert_eq!(check(&parameters, &proof, value), Err(Refused::Opening));
}

/// Where the words of the last message are, and before it those of two caps of segments, and of the steps.
fn last_message(parameters: &Parameters) -> usize {
    assert_eq!(parameters.variables(), 8);
    let (segments, steps) = ((2 * 4) << CAP, [4 << 6, 4 << 5]);
    segments + steps.iter().map(|cap| cap + 2 * 2).sum::<usize>()
}

/// Another value is claimed, and the last message makes up for it. The challenges follow from the statement alone here, as if the cheat had found words
/// with these.
#[test]
fn a_last_message_that_is_not_what_is_folded_is_refused() {
    let parameters = small(8, Rate::Half);
    let (mut proof, value) = argued(&parameters, 0, 0, true);
    fn verifier(proof: &[u64]) -> Verifier<'_> {
        Verifier::new(&STATEMENT, proof).deaf()
    }
    assert_eq!(check_with(&parameters, verifier(&proof), value), Ok(()));
    let mut drawing = verifier(&proof);
    weights(&mut drawing);
    let point = drawing.challenges(8);
    let weight = eq_table(&point[4..])[0];
    let place = last_message(&parameters);
    let words = Goldilocks::of_words(&proof[place..place + 2]).unwrap();
    let first = Extension::of_coefficients(words)[0] + weight.inverse();
    let changed = Extension::coefficients(&[first]).to_vec();
    for (word, coefficient) in proof[place..].iter_mut().zip(changed) {
        *word = coefficient.value();
    }
    let told = check_with(&parameters, verifier(&proof), value + Extension::ONE);
    let refused = Err(Refused::Equation("the last message of an opening"));
    assert_eq!(told, refused);
}

#[test]
fn positions_without_work_are_refused() {
    let parameters = small(8, Rate::Half);
    let (mut proof, value) = proof(&parameters);
    proof[last_message(&parameters) + 2 * 17] ^= 1;
    let told = check(&parameters, &proof, value);
    assert_eq!(told, Err(Refused::Work("positions")));
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
