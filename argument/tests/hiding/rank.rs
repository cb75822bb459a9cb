//! Any opened rows of a column can be those of any values: as many as its tail has coefficients.

use super::made::elements;
use zk0_argument::commitment::prove::Encoder;
use zk0_argument::field::Goldilocks;

/// The coefficients of a tail that follow from a codeword at as many positions, with elimination.
fn tail_of(positions: &[usize], codeword: &[Goldilocks], values: &[Goldilocks]) -> Vec<Goldilocks> {
    let encoder = Encoder::new(2);
    let without = encoder.encode(values, &[]);
    let generator = Goldilocks::root_of_unity(codeword.len().ilog2());
    let rows = positions.iter().map(|&position| {
        let point = generator.pow(position as u64);
        let first = point.pow(values.len() as u64);
        let powers = core::iter::successors(Some(first), |&power| Some(power * point));
        let mut row: Vec<Goldilocks> = powers.take(positions.len()).collect();
        row.push(codeword[position] - without[position]);
        row
    });
    solve(rows.collect()).expect("full rank")
}

/// The solution of equations, whose last entries are what the others add up to. `None` if there is none or there are several.
pub fn solve(mut rows: Vec<Vec<Goldilocks>>) -> Option<Vec<Goldilocks>> {
    let unknowns = rows[0].len() - 1;
    for column in 0..unknowns {
        let pivot = (column..rows.len()).find(|&row| rows[row][column] != Goldilocks::ZERO)?;
        rows.swap(column, pivot);
        let inverse = rows[column][column].inverse();
        let own: Vec<Goldilocks> = rows[column].iter().map(|&value| value * inverse).collect();
        for (number, row) in rows.iter_mut().enumerate() {
            if number == column {
                row.clone_from(&own);
                continue;
            }
            let factor = row[column];
            for (value, &own) in row[column..].iter_mut().zip(&own[column..]) {
                *value -= factor * own;
            }
        }
    }
    let rest = rows[unknowns..].iter();
    let consistent = rest.clone().all(|row| row[unknowns] == Goldilocks::ZERO);
    consistent.then(|| rows[..unknowns].iter().map(|row| row[unknowns]).collect())
}

/// So many different positions of all cosets.
pub fn positions(seed: u64, count: usize, length: usize) -> Vec<usize> {
    let mut positions = vec![];
    for element in elements(seed, 4 * count) {
        let position = element.value() as usize % length;
        if !positions.contains(&position) && positions.len() < count {
            positions.push(position);
        }
    }
    assert_eq!(positions.len(), count);
    positions
}

#[test]
fn the_opened_rows_determine_the_tail() {
    for (height, count) in [(12, 122), (16, 122), (10, 64)] {
        let values = elements(height, 1 << height);
        let tail = elements(height + 100, count);
        let codeword = Encoder::new(2).encode(&values, &tail);
        let positions = positions(height, count, codeword.len());
        for coset in 0..4 {
            assert!(positions.iter().any(|position| position % 4 == coset));
        }
        assert_eq!(tail_of(&positions, &codeword, &values), tail);
    }
}
