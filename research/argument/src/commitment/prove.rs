//! The prover's side of a commitment.

use super::query::cap_bits;
use super::{combination, work, Parameters, CAP, FOLDS, SIBLINGS, WORK};
use crate::field::{Extension, Goldilocks};
use crate::multilinear::{bind, eq_table, evaluate};
use crate::transcript::{Challenges, Prover};
use crate::tree::prove::Tree;
use bytemuck::TransparentWrapper;
use p3_dft::{Radix2DitParallel, TwoAdicSubgroupDft};
use p3_field::integers::QuotientMap;
use p3_field::PrimeField64;
use p3_matrix::dense::RowMajorMatrix;
use p3_matrix::Matrix;
use rayon::prelude::*;

/// A segment that was committed to: its values and their codewords.
pub struct Committed {
    /// The values by rows.
    rows: Vec<Goldilocks>,
    width: usize,
    codewords: Vec<Goldilocks>,
    tree: Tree,
}

impl Committed {
    /// Commits to polynomials and says the commitment. `rows` holds their values by rows: first the value of each polynomial at 0, then at
    /// 1, and so on. They are as many as the parameters say.
    pub fn new(
        prover: &mut Prover,
        parameters: &Parameters,
        rows: Vec<Goldilocks>,
        width: usize,
    ) -> Self {
        let codewords = encode(&rows, width, parameters.rate.bits());
        let tree = Tree::new(&codewords, width, CAP);
        tree.send_cap(prover);
        Self {
            rows,
            width,
            codewords,
            tree,
        }
    }

    fn column(&self, column: usize) -> Vec<Goldilocks> {
        self.rows
            .iter()
            .skip(column)
            .step_by(self.width)
            .copied()
            .collect()
    }
}

/// Opens all columns of `segments` at `point`. Returns their values there.
pub fn open(
    prover: &mut Prover,
    parameters: &Parameters,
    segments: &[&Committed],
    point: &[Extension],
) -> Vec<Extension> {
    let value = |segment: &Committed, column| evaluate(&segment.column(column), point);
    let columns = segments
        .iter()
        .flat_map(|segment| (0..segment.width).map(move |column| value(segment, column)));
    let values: Vec<Extension> = columns.collect();
    prover.send_extension(&values);

    let weights = combination(prover, values.len());
    let mut message = vec![Extension::ZERO; 1 << parameters.height];
    let mut first = 0;
    for segment in segments {
        let weights = &weights[first..first + segment.width];
        let rows = segment.rows.par_chunks_exact(segment.width);
        message
            .par_iter_mut()
            .zip(rows)
            .for_each(|(sum, row)| *sum += Extension::dot(weights, row));
        first += segment.width;
    }

    let mut codeword = encode_extension(&message, parameters.rate.bits());
    let mut trees = Vec::with_capacity(parameters.steps());
    let mut length = parameters.length();
    let mut bound = 0;
    for _ in 0..parameters.steps() {
        length -= FOLDS as u32;
        let leaves = leaves(&codeword);
        let tree = Tree::new(&leaves, 2 * SIBLINGS, cap_bits(length));
        tree.send_cap(prover);
        trees.push((tree, leaves));
        for _ in 0..FOLDS {
            let weights = eq_table(&point[bound + 1..]);
            let pairs = message.as_chunks::<2>().0.iter().zip(&weights);
            let slope = pairs
                .map(|(&[zero, one], &weight)| weight * (one - zero))
                .sum();
            prover.send_extension(&[slope]);
            let challenge = prover.challenge();
            bind(&mut message, challenge);
            codeword = fold(&codeword, challenge);
            bound += 1;
        }
    }
    prover.send_extension(&message);

    work::do_work(prover, WORK);
    for mut position in prover.positions(parameters.rate.queries(), parameters.length()) {
        for segment in segments {
            let row = &segment.codewords[position * segment.width..][..segment.width];
            segment.tree.open(prover, row, position);
        }
        let mut length = parameters.length();
        for (tree, leaves) in &trees {
            length -= FOLDS as u32;
            position &= (1 << length) - 1;
            let leaf = &leaves[2 * SIBLINGS * position..][..2 * SIBLINGS];
            tree.open(prover, leaf, position);
        }
    }
    values
}

type Theirs = p3_goldilocks::Goldilocks;

/// The codewords of the columns of a matrix, by rows.
fn encode(rows: &[Goldilocks], width: usize, rate: u32) -> Vec<Goldilocks> {
    let words = Goldilocks::peel_slice(rows).par_iter();
    let mut padded: Vec<Theirs> = words.map(|&word| Theirs::from_int(word)).collect();
    padded.resize(rows.len() << rate, Theirs::default());
    let codewords = Radix2DitParallel::default().dft_batch(RowMajorMatrix::new(padded, width));
    let codewords = codewords.to_row_major_matrix().values.into_par_iter();
    codewords
        .map(|value| Goldilocks::canonical(value.as_canonical_u64()))
        .collect()
}

/// The codeword of one message of the extension.
fn encode_extension(message: &[Extension], rate: u32) -> Vec<Extension> {
    let coefficients = Extension::coefficients(message);
    Extension::of_coefficients(&encode(coefficients, 2, rate)).to_vec()
}

/// The leaves of a codeword's tree: each holds the values that fold into one, which are equally far apart.
fn leaves(codeword: &[Extension]) -> Vec<Goldilocks> {
    let count = codeword.len() / SIBLINGS;
    let siblings =
        |leaf: usize| (0..SIBLINGS).flat_map(move |sibling| codeword[leaf + sibling * count].0);
    (0..count).flat_map(siblings).collect()
}

/// The codeword of the polynomial with its first variable bound: half as long.
fn fold(codeword: &[Extension], challenge: Extension) -> Vec<Extension> {
    let half = codeword.len() / 2;
    let step = Goldilocks::root_of_unity(codeword.len().ilog2()).inverse();
    let mut inverse = Goldilocks::ONE;
    let mut folded = Vec::with_capacity(half);
    for (&u, &v) in codeword[..half].iter().zip(&codeword[half..]) {
        let sum = u + v;
        let twice = sum + challenge * ((u - v).scale(inverse) - sum);
        folded.push(twice.halved());
        inverse *= step;
    }
    folded
}
