//! Words that one sample's argument states are explained by another sample with the same losses: there is a blinding with which its argument states the same
//! words, but for digests. So the words show nothing of either.

use super::made::{alike, extension, Blinding, Made};
use std::collections::BTreeMap;
use zk0_argument::commitment::prove::Hiding;
use zk0_argument::expert::argument::DrawnPoints;
use zk0_argument::field::{Extension, Goldilocks};
use zk0_argument::multilinear::eq_bits;
use zk0_argument::opening::RANDOM;

/// How often a column's coefficients lie in one piece of the code, as a binary logarithm.
const RATE: u32 = 2;

/// The coefficients of the polynomial of least degree with these values.
fn interpolate(points: &[Goldilocks], values: &[Goldilocks]) -> Vec<Goldilocks> {
    let mut differences = values.to_vec();
    for order in 1..points.len() {
        for index in (order..points.len()).rev() {
            let step = (points[index] - points[index - order]).inverse();
            differences[index] = (differences[index] - differences[index - 1]) * step;
        }
    }
    let mut coefficients = vec![];
    for (&point, &difference) in points.iter().zip(&differences).rev() {
        let mut next = vec![Goldilocks::ZERO; coefficients.len() + 1];
        for (degree, &coefficient) in coefficients.iter().enumerate() {
            next[degree + 1] += coefficient;
            next[degree] -= coefficient * point;
        }
        next[0] += difference;
        coefficients = next;
    }
    coefficients
}

/// A column of the first argument and of the second one, with values and tail.
struct Column {
    values: Vec<Goldilocks>,
    tail: Vec<Goldilocks>,
}

impl Column {
    /// The tail with which other values have the same codeword at some positions. It differs in as many coefficients.
    fn tail_for(&self, values: &[Goldilocks], length: u32, positions: &[usize]) -> Vec<Goldilocks> {
        let generator = Goldilocks::root_of_unity(length);
        let points = positions
            .iter()
            .map(|&position| generator.pow(position as u64));
        let points: Vec<Goldilocks> = points.collect();
        let differences: Vec<Goldilocks> = self
            .values
            .iter()
            .zip(values)
            .map(|(&a, &b)| a - b)
            .collect();
        let values = points.iter().map(|&point| {
            let difference = differences
                .iter()
                .rev()
                .fold(Goldilocks::ZERO, |sum, &coefficient| {
                    sum * point + coefficient
                });
            difference * point.pow(values.len() as u64).inverse()
        });
        let values: Vec<Goldilocks> = values.collect();
        let mut tail = self.tail.clone();
        for (coefficient, change) in tail.iter_mut().zip(interpolate(&points, &values)) {
            *coefficient += change;
        }
        tail
    }
}

/// What the first world states with `blinding`, and the blinding with which the second one states the same.
fn explain([first, second]: [&Made; 2], blinding: &Blinding) -> (Vec<u64>, Blinding) {
    let first_random = first.shape.first_random();
    let parameters = &first.shape.parameters;
    let height = 1usize << parameters.variables();
    let room = parameters.longest_tail();
    let [u, g] = [RANDOM - 1, 0].map(|random| first_random + random);
    let random = |column: usize| blinding.argument.elements(column, height + room);
    let honest = first.argue(blinding, true);
    let (words, places) = (honest.words().to_vec(), honest.places().to_vec());
    let said = |words: &[u64], pad: usize| places[pad].map(|place| extension(words, place));

    // With the same pads, what a secret value is stated as differs as the value does.
    let mut pads = random(u);
    let add = |pads: &mut Vec<Goldilocks>, pad: usize, change: Extension| {
        pads[2 * pad] += change.0[0];
        pads[2 * pad + 1] += change.0[1];
    };
    let with = |pads: &[Goldilocks]| {
        let mut blinding = blinding.clone();
        blinding.argument.columns.insert(u, pads.to_vec());
        second.argue(&blinding, true).words().to_vec()
    };
    let masks: Vec<usize> = (0..places.len())
        .filter(|&pad| places[pad].is_none())
        .collect();
    let gates = masks[0]..masks[masks.len() - 1] + 1;
    let of_g = gates.start - 1;
    let after_t = places[gates.end].unwrap() + 4;
    let other = with(&pads);
    for pad in 0..of_g {
        let change = said(&words, pad).unwrap() - said(&other, pad).unwrap();
        add(&mut pads, pad, change);
    }
    // The second argument's value of g makes up for what the columns differ by, so that M has the same value.
    let DrawnPoints {
        point,
        weights,
        mut positions,
    } = first.drawn(&words);
    let psi = weights[g];
    let there = places[of_g].unwrap() + 2 + 1;
    let change = (extension(&words, there) - extension(&other, there)) * psi.inverse();
    add(&mut pads, of_g, -change);
    // One mask more by 1 tells what masks are multiplied with.
    let factor = |words: &[u64], mask: usize| extension(words, after_t + 2 * mask);
    add(&mut pads, gates.start, Extension::ONE);
    let again = with(&pads);
    add(&mut pads, gates.start, -Extension::ONE);
    let rho = factor(&again, 0) - factor(&other, 0);
    for (number, pad) in gates.clone().enumerate() {
        let change = factor(&words, number) - factor(&other, number);
        add(&mut pads, pad, change * rho.inverse());
    }
    let again = with(&pads);
    for pad in [gates.end, gates.end + 1] {
        let change = said(&words, pad).unwrap() - said(&again, pad).unwrap();
        add(&mut pads, pad, change);
    }
    // U has the same value at the point as before: two entries after the last pad see to that.
    let before = random(u);
    let used = 2 * places.len();
    let table = |index: usize| eq_bits(index, &point);
    let difference = (0..used).map(|index| table(index).scale(before[index] - pads[index]));
    let missing: Extension = difference.sum();
    // missing = a·x + b·y for x and y of the base field
    let (a, b) = (table(used), table(used + 1));
    let determinant = a.0[0] * b.0[1] - a.0[1] * b.0[0];
    let inverse = determinant.inverse();
    pads[used] += (missing.0[0] * b.0[1] - missing.0[1] * b.0[0]) * inverse;
    pads[used + 1] += (a.0[0] * missing.0[1] - a.0[1] * missing.0[0]) * inverse;

    // Tails, with which the opened rows are the same
    let length = parameters.variables() as u32 + RATE;
    positions.sort_unstable();
    positions.dedup();
    let mut result = blinding.clone();
    let [old, new] = [first.columns(), second.columns()];
    let mut tails = BTreeMap::new();
    let main = first_random;
    for (number, (old, new)) in old.into_iter().zip(&new).enumerate() {
        let (hiding, column, count) = match number.checked_sub(main) {
            None => (&mut result.argument, number, parameters.positions()),
            Some(data) => {
                let width = first.shape.widths[1];
                (&mut result.samples[data / width], data % width, room)
            }
        };
        let column_of_old = Column {
            values: old,
            tail: hiding.elements(column, count),
        };
        let tail = column_of_old.tail_for(new, length, &positions);
        hiding.columns.insert(column, tail.clone());
        tails.insert(number, [column_of_old.tail, tail]);
    }
    let tail = before[height..].to_vec();
    let old = Column {
        values: before[..height].to_vec(),
        tail: tail.clone(),
    };
    let tail_of_u = old.tail_for(&pads[..height], length, &positions);
    pads.splice(height.., tail_of_u.clone());
    // F is the same, so g makes up for all that differs.
    let mut sums = vec![Extension::ZERO; height + room];
    let without: Vec<Extension> = weights
        .iter()
        .enumerate()
        .filter(|(number, _)| !(g..g + RANDOM).contains(number))
        .map(|(_, &weight)| weight)
        .collect();
    let old = first.columns();
    for (number, &weight) in without.iter().enumerate() {
        for (sum, (&old, &new)) in sums.iter_mut().zip(old[number].iter().zip(&new[number])) {
            *sum += weight.scale(old - new);
        }
        let [old, new] = &tails[&number];
        for (sum, (&old, &new)) in sums[height..].iter_mut().zip(old.iter().zip(new)) {
            *sum += weight.scale(old - new);
        }
    }
    let xi = weights[u];
    for (sum, (&old, &new)) in sums.iter_mut().zip(before.iter().zip(&pads)) {
        *sum += xi.scale(old - new);
    }
    let inverse = psi.inverse();
    let changes: Vec<Extension> = sums.into_iter().map(|sum| sum * inverse).collect();
    for part in 0..2 {
        let mut column = random(g + part);
        for (value, change) in column.iter_mut().zip(&changes) {
            *value += change.0[part];
        }
        result.argument.columns.insert(g + part, column);
    }
    result.argument.columns.insert(u, pads);
    (words, result)
}

/// Whether the second world has a blinding with which it states the words of the first one, but for digests.
fn explained(samples: usize, seed: u64) {
    let [first, second] = alike(samples, seed).map(|models| Made::new(&models));
    assert_eq!(first.statement.digest(), second.statement.digest());
    assert_ne!(first.columns(), second.columns());
    let blinding = Blinding::of(seed, samples as u64);
    let (words, explained) = explain([&first, &second], &blinding);
    let other = second.argue(&explained, true).words().to_vec();
    assert_eq!(words.len(), other.len());
    let caps = 0..4 * 64 * (1 + samples);
    let queries = first.queries(words.len());
    let paths = queries
        .iter()
        .flat_map(|query| &query.segments)
        .map(|(_, path)| path.clone());
    let digests: Vec<_> = paths.chain([caps]).collect();
    let differing = (0..words.len()).filter(|&place| words[place] != other[place]);
    let differing = differing.filter(|place| !digests.iter().any(|range| range.contains(place)));
    let differing: Vec<usize> = differing.collect();
    assert_eq!(differing, [0; 0], "of {} words", words.len());
}

#[test]
fn another_sample_explains_the_words_of_an_argument() {
    explained(1, 91);
}

#[test]
fn other_samples_explain_the_words_of_an_argument() {
    explained(2, 93);
}

#[test]
#[ignore = "half an hour: `make hiding`"]
fn other_samples_explain_the_words_of_a_hundred_models() {
    (100..200).for_each(|seed| explained(1 + seed as usize % 3, seed));
}
