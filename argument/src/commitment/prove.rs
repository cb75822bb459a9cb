//! The prover's side of a commitment.
//!
//! Codewords are not kept: they are several times as long as the values. They are computed one coset after the other, hashed, and computed
//! once more when the positions are known. Of the tree only the levels near the cap are kept. Memory is that of the values, of one coset of one
//! matrix, and of 32 bytes for each row while a segment is committed to.

pub mod columns;
mod encode;
mod matrix;
mod rows;
mod stored;

use super::parameters::{cap_bits, Parameters, CAP, FOLDS, POSITION_WORK, SALT, SIBLINGS};
use crate::field::{Extension, Goldilocks};
use crate::hash::packed::{self, SpongeCapacity, LANES};
use crate::hash::SpongeDigest;
use crate::multilinear::{bind, eq_table};
use crate::prove::progress::{Phase, Tell};
use crate::transcript::work;
use crate::transcript::{Challenges, Prover};
use crate::tree::prove::{parents, Tree};
use columns::{add_combination, evaluate};
pub use encode::Encoder;
use encode::{encode_extension, fold};
pub use matrix::CodeMatrix;
use p3_field::PrimeField64;
use rayon::prelude::*;
use std::io;
use std::path::Path;

/// Binary logarithm of the values of rows that are below one digest of the tree's lowest level that is kept.
const BELOW: u32 = 13;
/// Values below which a loop is not worth sharing among cores.
const SHARED: usize = 1 << 12;

/// Where the random elements come from that hide what is in a tree. They are the same whenever they are asked for.
pub trait Hiding: Send + Sync {
    /// So many elements of a column, which are uniform.
    fn elements(&self, column: usize, count: usize) -> Vec<Goldilocks>;
    /// The salts of so many leaves from this one on.
    fn salts(&self, first: usize, count: usize) -> Vec<[Goldilocks; SALT]>;
}

/// A segment whose matrices are being committed to, one after the other.
pub struct Committing {
    parameters: Parameters,
    encoder: Encoder,
    /// Of each row what it is up to now, one coset after the other.
    begun: Vec<SpongeCapacity>,
    matrices: Vec<CodeMatrix>,
}

impl Committing {
    /// To matrices that have so many columns together.
    pub fn new(parameters: &Parameters, columns: usize) -> Self {
        Self {
            parameters: *parameters,
            encoder: Encoder::new(parameters.rate.bits()),
            begun: vec![SpongeCapacity::new(columns + SALT); 1 << parameters.length()],
            matrices: vec![],
        }
    }

    /// Commits to a matrix which is not the last one.
    pub fn add(&mut self, matrix: CodeMatrix) {
        let (width, height) = (matrix.width(), 1usize << self.parameters.height);
        let cosets = self.begun.chunks_exact_mut(height).enumerate();
        for (coset, begun) in cosets {
            let values = matrix.coset(&self.encoder, coset);
            let blocks = begun.par_chunks_mut(LANES).enumerate();
            blocks.for_each(|(block, begun)| {
                packed::absorb(begun, width, |row, column| {
                    values[(block * LANES + row) * width + column].as_canonical_u64()
                });
            });
        }
        self.matrices.push(matrix);
    }

    /// Moves the values of the matrix that was added last to files in a folder, if there is one.
    pub fn into_files(&mut self, folder: Option<&Path>) -> io::Result<()> {
        if let Some(last) = self.matrices.pop() {
            self.matrices.push(last.into_files(folder)?);
        }
        Ok(())
    }

    /// Commits to the last matrix, and to salts.
    pub fn finish(mut self, last: CodeMatrix, hiding: Box<dyn Hiding>) -> CommittedSegment {
        let (width, height) = (last.width(), 1usize << self.parameters.height);
        let parameters = self.parameters;
        let columns: usize = self.matrices.iter().map(CodeMatrix::width).sum();
        let missing = missing(&parameters, columns + width);
        let mut lowest = Vec::with_capacity(1 << (parameters.length() - missing));
        for coset in self.encoder.order() {
            let begun = &self.begun[coset * height..][..height];
            let values = last.coset(&self.encoder, coset);
            let mut digests = vec![SpongeDigest::default(); height];
            let blocks = digests.par_chunks_mut(SHARED.min(height)).enumerate();
            blocks.for_each(|(block, digests)| {
                let first = block * SHARED;
                let salts = hiding.salts(coset * height + first, digests.len());
                for (block, digests) in digests.chunks_mut(LANES).enumerate() {
                    let offset = block * LANES;
                    let element = |row: usize, column: usize| match column.checked_sub(width) {
                        None => values[(first + offset + row) * width + column].as_canonical_u64(),
                        Some(place) => salts[offset + row][place].value(),
                    };
                    let begun = &begun[first + offset..][..digests.len()];
                    packed::finish(begun, width + SALT, element, digests);
                }
            });
            for _ in 0..missing {
                digests = parents(&digests);
            }
            lowest.extend(digests);
        }
        self.begun.clear();
        self.begun.shrink_to_fit();
        self.matrices.push(last);
        CommittedSegment {
            matrices: self.matrices,
            hiding,
            tree: Tree::of_leaves(lowest, CAP),
            missing,
        }
    }
}

/// How many of the lowest levels of a tree over so many columns are not kept.
fn missing(parameters: &Parameters, columns: usize) -> u32 {
    let missing = BELOW.saturating_sub(columns.next_power_of_two().ilog2());
    missing.clamp(4, 10).min(parameters.length() - CAP)
}

/// A segment that was committed to.
pub struct CommittedSegment {
    matrices: Vec<CodeMatrix>,
    hiding: Box<dyn Hiding>,
    /// The tree, without the lowest levels.
    tree: Tree,
    /// How many levels are missing. 2^`missing` rows of one coset are below one digest of the tree's lowest level.
    missing: u32,
}

impl CommittedSegment {
    /// To a matrix that was committed to before, whose tree had these digests in the lowest level that is kept. `None` if it has another number of them.
    pub fn again(
        parameters: &Parameters,
        matrix: CodeMatrix,
        hiding: Box<dyn Hiding>,
        lowest: Vec<SpongeDigest>,
    ) -> Option<Self> {
        let missing = missing(parameters, matrix.width());
        let all = lowest.len() == 1 << (parameters.length() - missing);
        all.then(|| Self {
            matrices: vec![matrix],
            hiding,
            tree: Tree::of_leaves(lowest, CAP),
            missing,
        })
    }

    /// The digests of the lowest level that is kept of the tree: [`Self::again`] takes them.
    pub fn lowest(&self) -> &[SpongeDigest] {
        self.tree.leaves()
    }

    /// States the commitment.
    pub fn say(&self, prover: &mut Prover) {
        self.tree.send_cap(prover);
    }

    /// Moves the values to files in a folder, if there is one.
    pub fn into_files(mut self, folder: Option<&Path>) -> io::Result<Self> {
        let matrices = self.matrices.into_iter();
        let moved = matrices.map(|matrix| matrix.into_files(folder));
        self.matrices = moved.collect::<io::Result<_>>()?;
        Ok(self)
    }

    /// What was committed to.
    pub fn matrices(&self) -> &[CodeMatrix] {
        &self.matrices
    }

    /// The digests of the highest nodes of its tree.
    pub fn cap(&self) -> &[SpongeDigest] {
        self.tree.cap()
    }

    fn width(&self) -> usize {
        self.matrices.iter().map(CodeMatrix::width).sum()
    }

    /// The values of all columns at a point.
    pub fn at(&self, point: &[Extension]) -> Vec<Extension> {
        let matrices = self.matrices.iter();
        let values = matrices.flat_map(|matrix| {
            let values = evaluate(&matrix.columns, point);
            matrix.release();
            values
        });
        values.collect()
    }

    /// For each position, the row of all codewords there and its salt, and its path to the cap. `encoded` is told how many columns are done.
    fn open(
        &self,
        parameters: &Parameters,
        positions: &[usize],
        encoded: &mut dyn FnMut(usize),
    ) -> Vec<OpenedRow> {
        let encoder = Encoder::new(parameters.rate.bits());
        let width = self.width();
        let rows = 1usize << self.missing;
        // Of each position, the rows that are below the same digest of the tree's lowest level.
        let numbers = positions
            .iter()
            .map(|&position| parameters.leaf(position) >> self.missing);
        let numbers: Vec<usize> = numbers.collect();
        let wide = width + SALT;
        let mut groups = vec![vec![0; rows * wide]; positions.len()];
        let mut column = 0;
        for matrix in &self.matrices {
            let dimensions = (self.missing, parameters.length());
            let own = rows::rows(&encoder, matrix, &numbers, dimensions);
            groups.par_iter_mut().zip(own).for_each(|(group, own)| {
                let own = own.chunks_exact(matrix.width());
                for (target, row) in group.chunks_exact_mut(wide).zip(own) {
                    let target = target[column..].iter_mut().zip(row);
                    target.for_each(|(to, value)| *to = value.as_canonical_u64());
                }
            });
            matrix.release();
            column += matrix.width();
            encoded(matrix.width());
        }
        let opened = groups.into_par_iter().zip(positions).zip(numbers);
        let opened = opened.map(|((mut group, &position), number)| {
            let (coset, row) = encoder.place(position, parameters.height);
            let first = (coset << parameters.height) + (row & !(rows - 1));
            let salts = self.hiding.salts(first, rows);
            for (target, salt) in group.chunks_exact_mut(wide).zip(&salts) {
                let target = target[width..].iter_mut().zip(salt);
                target.for_each(|(to, value)| *to = value.value());
            }
            let lowest = Tree::of_leaves(self.leaves(&group, rows), 0);
            let place = parameters.leaf(position) % rows;
            let mut path = lowest.path(place);
            path.extend(self.tree.path(number));
            let row = group[place * wide..][..wide].iter();
            OpenedRow {
                row: row.map(|&value| Goldilocks::canonical(value)).collect(),
                path,
            }
        });
        opened.collect()
    }

    /// The digests of so many rows with their salts.
    fn leaves(&self, group: &[u64], rows: usize) -> Vec<SpongeDigest> {
        let wide = self.width() + SALT;
        let mut digests = vec![SpongeDigest::default(); rows];
        for (block, digests) in digests.chunks_mut(LANES).enumerate() {
            let element = |row: usize, column: usize| group[(block * LANES + row) * wide + column];
            let mut begun = vec![SpongeCapacity::new(wide); digests.len()];
            let mut first = 0;
            for matrix in &self.matrices[..self.matrices.len() - 1] {
                packed::absorb(&mut begun, matrix.width(), |row, column| {
                    element(row, first + column)
                });
                first += matrix.width();
            }
            let last = |row: usize, column: usize| element(row, first + column);
            packed::finish(&begun, wide - first, last, digests);
        }
        digests
    }
}

/// A row that is opened, with its salt.
struct OpenedRow {
    row: Vec<Goldilocks>,
    path: Vec<SpongeDigest>,
}

/// A polynomial over the extension: its values, and the coefficients that follow them.
pub struct Message {
    /// The values.
    pub values: Vec<Extension>,
    /// As many as the longest tail has.
    pub tail: Vec<Extension>,
}

impl Message {
    /// `Σ weights · columns`, one segment after the other.
    pub fn of_columns(
        parameters: &Parameters,
        segments: &[&CommittedSegment],
        weights: &[Extension],
    ) -> Self {
        let mut values = vec![Extension::ZERO; 1 << parameters.height];
        let mut tail = vec![Extension::ZERO; parameters.longest_tail()];
        let mut rest = weights;
        for matrix in segments.iter().flat_map(|segment| &segment.matrices) {
            let (weights, later) = rest.split_at(matrix.width());
            rest = later;
            add_combination(&matrix.columns, weights, &mut values);
            matrix.release();
            for (weight, own) in weights.iter().zip(&matrix.tails) {
                for (sum, &coefficient) in tail.iter_mut().zip(own) {
                    *sum += weight.scale(coefficient);
                }
            }
        }
        Self { values, tail }
    }

    /// Adds a column of the last matrix of a segment, times `weight`.
    pub fn add_random(&mut self, segment: &CommittedSegment, column: usize, weight: Extension) {
        let Some(matrix) = segment.matrices.last() else {
            return;
        };
        let (columns, weights) = (&matrix.columns[column..=column], &[weight]);
        add_combination(columns, weights, &mut self.values);
        for (sum, &coefficient) in self.tail.iter_mut().zip(&matrix.tails[column]) {
            *sum += weight.scale(coefficient);
        }
    }
}

/// Opens a combination of all columns of `segments` at `point`.
pub fn open(
    prover: &mut Prover,
    parameters: &Parameters,
    segments: &[&CommittedSegment],
    message: Message,
    point: &[Extension],
    tell: Tell<'_>,
) {
    let Message {
        values: mut message,
        mut tail,
    } = message;
    // Nearly all of the time goes into encoding the columns again.
    let width: usize = segments.iter().map(|segment| segment.width()).sum();
    let mut codeword = encode_extension(&message, &tail, parameters.rate.bits());
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
            prover.send_masked(&[slope]);
            *challenge = prover.challenge();
            bind(&mut message, *challenge);
            bind(&mut tail, *challenge);
            bound += 1;
        }
        let mut next = fold(&codeword, challenges[0]);
        for &challenge in &challenges[1..] {
            next = fold(&next, challenge);
        }
        committed.push((tree, core::mem::replace(&mut codeword, next)));
    }
    message.extend(tail);
    prover.send_masked(&message);

    work::do_work(prover, POSITION_WORK);
    let positions = prover.positions(parameters.positions, parameters.length());
    let mut opened: Vec<Vec<OpenedRow>> = Vec::with_capacity(segments.len());
    let mut encoded = 0;
    for segment in segments {
        opened.push(segment.open(parameters, &positions, &mut |columns| {
            encoded += columns;
            tell(Phase::Opening, encoded as f64 / width as f64);
        }));
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
}
