//! The prover's side of a commitment.
//!
//! Codewords are not kept: they are several times as long as the values. They are computed one coset after the other, hashed, and computed
//! once more when the positions are known. Of the tree only the levels near the cap are kept. Memory is that of the values, of one coset, and of
//! the digests of all rows while a segment is committed to.

pub mod columns;
mod stored;

use super::combination;
use super::parameters::{cap_bits, Parameters, CAP, FOLDS, SIBLINGS, WORK};
use crate::field::{Extension, Goldilocks};
use crate::hash::Digest;
use crate::multilinear::{bind, eq_table};
use crate::prove::progress::{Phase, Tell};
use crate::transcript::work;
use crate::transcript::{Challenges, Prover};
use crate::tree::prove::{leaves, parents, Tree};
use bytemuck::TransparentWrapper;
use columns::{add_combination, evaluate, of_rows, to_rows, Column};
use p3_dft::{Radix2DitParallel, TwoAdicSubgroupDft};
use p3_field::PrimeField64;
use p3_goldilocks::Goldilocks as Theirs;
use p3_matrix::bitrev::BitReversibleMatrix;
use p3_matrix::dense::RowMajorMatrix;
use rayon::prelude::*;
use std::io;
use std::path::Path;

/// Binary logarithm of the digests of the lowest level that is kept.
const KEPT: u32 = 14;
/// Values below which a loop is not worth sharing among cores.
const SHARED: usize = 1 << 12;

/// A segment that was committed to.
pub struct Committed {
    columns: Vec<Column>,
    /// The tree, without the lowest levels.
    tree: Tree,
    /// How many levels are missing. Rows of 2^`missing` positions are below one digest of the tree's lowest level.
    missing: u32,
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
        let columns = of_rows(&rows, width);
        drop(rows);
        Self::of_columns(prover, parameters, columns)
    }

    /// Likewise, to polynomials whose values are given one after the other.
    pub fn of_columns(prover: &mut Prover, parameters: &Parameters, columns: Vec<Column>) -> Self {
        let committed = Self::to(parameters, columns);
        committed.say(prover);
        committed
    }

    /// Says the commitment.
    pub fn say(&self, prover: &mut Prover) {
        self.tree.send_cap(prover);
    }

    /// Moves the values to files in a folder.
    pub fn into_files(mut self, folder: &Path) -> io::Result<Self> {
        let columns = self.columns.into_iter();
        let moved = columns.map(|column| column.into_file(folder));
        self.columns = moved.collect::<io::Result<_>>()?;
        Ok(self)
    }

    /// What was committed to.
    pub fn columns(&self) -> &[Column] {
        &self.columns
    }

    /// The digests of the highest nodes of its tree.
    pub fn cap(&self) -> &[Digest] {
        self.tree.cap()
    }

    /// The commitment to polynomials, which nobody has said yet.
    pub fn to(parameters: &Parameters, columns: Vec<Column>) -> Self {
        let encoder = Encoder::new(parameters.rate.bits());
        let (width, height) = (columns.len(), 1 << parameters.height);
        let cosets: Vec<Vec<Digest>> = (0..encoder.cosets())
            .map(|coset| {
                let values = encoder.coset(to_rows(&columns), width, coset);
                leaves(height, width, |row, column| {
                    values[row * width + column].as_canonical_u64()
                })
            })
            .collect();
        let all = (0..height * cosets.len()).into_par_iter();
        let mut digests: Vec<Digest> = all
            .map(|position| {
                let (coset, row) = encoder.place(position, parameters.height);
                cosets[coset][row]
            })
            .collect();
        drop(cosets);
        let missing = parameters.length().saturating_sub(KEPT);
        for _ in 0..missing {
            digests = parents(&digests);
        }
        let tree = Tree::of_leaves(digests, CAP);
        Self {
            columns,
            tree,
            missing,
        }
    }

    /// Drops values that are in files from the process's memory, until somebody uses them again.
    fn release(&self) {
        self.columns.iter().for_each(Column::release);
    }

    fn width(&self) -> usize {
        self.columns.len()
    }

    /// For each position, the row of all codewords there, and its path to the cap.
    fn open(&self, parameters: &Parameters, positions: &[usize]) -> Vec<OpenedRow> {
        let encoder = Encoder::new(parameters.rate.bits());
        let width = self.width();
        let rows = 1usize << self.missing;
        // Of each position, the rows that are below the same digest of the tree's lowest level.
        let mut groups = vec![vec![Goldilocks::ZERO; rows * width]; positions.len()];
        for coset in 0..encoder.cosets() {
            let values = encoder.coset(to_rows(&self.columns), width, coset);
            for (group, position) in groups.iter_mut().zip(positions) {
                let first = position & !(rows - 1);
                for (position, target) in (first..).zip(group.chunks_exact_mut(width)) {
                    let (of, row) = encoder.place(position, parameters.height);
                    if of == coset {
                        let row = values[row * width..][..width].iter().map(ours);
                        target
                            .iter_mut()
                            .zip(row)
                            .for_each(|(to, value)| *to = value);
                    }
                }
            }
        }
        let opened = groups.into_iter().zip(positions).map(|(group, position)| {
            let element = |row: usize, column: usize| group[row * width + column].value();
            let lowest = Tree::new(rows, width, 0, element);
            let place = position % rows;
            let mut path = lowest.path(place);
            path.extend(self.tree.path(position >> self.missing));
            OpenedRow {
                row: group[place * width..][..width].to_vec(),
                path,
            }
        });
        opened.collect()
    }
}

/// A row that is opened.
struct OpenedRow {
    row: Vec<Goldilocks>,
    path: Vec<Digest>,
}

/// Opens all columns of `segments` at `point`. Returns their values there.
pub fn open(
    prover: &mut Prover,
    parameters: &Parameters,
    segments: &[&Committed],
    point: &[Extension],
    tell: Tell<'_>,
) -> Vec<Extension> {
    // Nearly all of the time goes into encoding the columns again.
    let width: usize = segments.iter().map(|segment| segment.width()).sum();
    let mut values = Vec::with_capacity(width);
    for segment in segments {
        values.extend(evaluate(&segment.columns, point));
        segment.release();
    }
    prover.send_extension(&values);
    work::do_work(prover, WORK);

    let weights = combination(prover, values.len());
    let mut message = vec![Extension::ZERO; 1 << parameters.height];
    let mut first = 0;
    for segment in segments {
        let weights = &weights[first..first + segment.width()];
        add_combination(&segment.columns, weights, &mut message);
        segment.release();
        first += segment.width();
    }

    let mut codeword = encode_extension(&message, parameters.rate.bits());
    let mut committed = Vec::with_capacity(parameters.steps());
    let mut length = parameters.length();
    let mut bound = 0;
    for _ in 0..parameters.steps() {
        length -= FOLDS as u32;
        // A leaf holds the values that fold into one, which are equally far apart.
        let count = 1 << length;
        let element = |leaf: usize, coefficient: usize| {
            codeword[leaf + coefficient / 2 * count].0[coefficient % 2].value()
        };
        let tree = Tree::new(count, 2 * SIBLINGS, cap_bits(length), element);
        tree.send_cap(prover);
        let mut challenges = [Extension::ZERO; FOLDS];
        for challenge in &mut challenges {
            let weights = eq_table(&point[bound + 1..]);
            let pairs = message.as_chunks::<2>().0.iter().zip(&weights);
            let slope = pairs
                .map(|(&[zero, one], &weight)| weight * (one - zero))
                .sum();
            prover.send_extension(&[slope]);
            *challenge = prover.challenge();
            bind(&mut message, *challenge);
            bound += 1;
        }
        let mut next = fold(&codeword, challenges[0]);
        for &challenge in &challenges[1..] {
            next = fold(&next, challenge);
        }
        committed.push((tree, core::mem::replace(&mut codeword, next)));
    }
    prover.send_extension(&message);

    work::do_work(prover, WORK);
    let positions = prover.positions(parameters.rate.queries(), parameters.length());
    let mut opened: Vec<Vec<OpenedRow>> = Vec::with_capacity(segments.len());
    let mut encoded = 0;
    for segment in segments {
        opened.push(segment.open(parameters, &positions));
        segment.release();
        encoded += segment.width();
        tell(Phase::Opening, encoded as f64 / width as f64);
    }
    for (number, &position) in positions.iter().enumerate() {
        for rows in &opened {
            let OpenedRow { row, path } = &rows[number];
            prover.hint(row);
            path.iter().for_each(|digest| prover.hint_digest(digest));
        }
        let mut leaf = position;
        for (tree, codeword) in &committed {
            let count = codeword.len() / SIBLINGS;
            leaf %= count;
            let siblings: [Extension; SIBLINGS] =
                core::array::from_fn(|sibling| codeword[leaf + sibling * count]);
            tree.open(prover, Extension::coefficients(&siblings), leaf);
        }
    }
    values
}

fn ours(value: &Theirs) -> Goldilocks {
    Goldilocks::canonical(value.as_canonical_u64())
}

/// Computes the codewords of a matrix' columns. The points of a codeword are cosets of those of a code without redundancy: position
/// 2^rate·j + k of a codeword is position j of coset k.
struct Encoder {
    dft: Radix2DitParallel<Theirs>,
    rate: u32,
}

impl Encoder {
    fn new(rate: u32) -> Self {
        Self {
            dft: Radix2DitParallel::default(),
            rate,
        }
    }

    fn cosets(&self) -> usize {
        1 << self.rate
    }

    /// The codewords of a matrix on one coset, by rows. [`Self::place`] says where each row is.
    fn coset(&self, rows: Vec<Theirs>, width: usize, coset: usize) -> Vec<Theirs> {
        let bits = (rows.len() / width).ilog2() + self.rate;
        let shift = Goldilocks::root_of_unity(bits).pow(coset as u64);
        let matrix = RowMajorMatrix::new(rows, width);
        let codewords = self.dft.coset_dft_batch(matrix, Theirs::new(shift.value()));
        // The rows lie in the order of their reversed bits. To reverse it twice changes nothing.
        codewords.bit_reverse_rows().values
    }

    /// The coset that a position is in, and the row of it, of 2^`bits` rows.
    fn place(&self, position: usize, bits: u32) -> (usize, usize) {
        let row = position >> self.rate;
        (
            position % self.cosets(),
            row.reverse_bits() >> (usize::BITS - bits),
        )
    }
}

/// The codeword of one message of the extension.
fn encode_extension(message: &[Extension], rate: u32) -> Vec<Extension> {
    let encoder = Encoder::new(rate);
    let words = Goldilocks::peel_slice(Extension::coefficients(message));
    let coefficients = || words.iter().map(|&word| Theirs::new(word)).collect();
    let cosets: Vec<Vec<Theirs>> = (0..encoder.cosets())
        .map(|coset| encoder.coset(coefficients(), 2, coset))
        .collect();
    let bits = message.len().ilog2();
    let value = |position: usize| {
        let (coset, row) = encoder.place(position, bits);
        Extension([2 * row, 2 * row + 1].map(|place| ours(&cosets[coset][place])))
    };
    (0..message.len() << rate)
        .into_par_iter()
        .map(value)
        .collect()
}

/// The codeword of the polynomial with its first variable bound: half as long.
fn fold(codeword: &[Extension], challenge: Extension) -> Vec<Extension> {
    let (low, high) = codeword.split_at(codeword.len() / 2);
    let step = Goldilocks::root_of_unity(codeword.len().ilog2()).inverse();
    let mut folded = vec![Extension::ZERO; low.len()];
    let chunks = folded.par_chunks_mut(SHARED).enumerate();
    let chunks = chunks.zip(low.par_chunks(SHARED).zip(high.par_chunks(SHARED)));
    chunks.for_each(|((chunk, folded), (low, high))| {
        let mut inverse = step.pow((chunk * SHARED) as u64);
        for ((folded, &u), &v) in folded.iter_mut().zip(low).zip(high) {
            let sum = u + v;
            let twice = sum + challenge * ((u - v).scale(inverse) - sum);
            *folded = twice.halved();
            inverse *= step;
        }
    });
    folded
}
