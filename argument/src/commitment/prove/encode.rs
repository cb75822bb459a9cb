//! Reed–Solomon codewords of columns with tails, and their folds.

use crate::field::{Extension, Goldilocks};
use bytemuck::TransparentWrapper;
use p3_dft::{Radix2DitParallel, TwoAdicSubgroupDft};
use p3_field::PrimeField64;
use p3_goldilocks::Goldilocks as Theirs;
use p3_matrix::bitrev::BitReversibleMatrix;
use p3_matrix::dense::RowMajorMatrix;
use rayon::prelude::*;

/// Values below which a loop is not worth sharing among cores.
const SHARED: usize = 1 << 12;

fn ours(value: &Theirs) -> Goldilocks {
    Goldilocks::canonical(value.as_canonical_u64())
}

/// Computes the codewords of a matrix' columns. The points of a codeword are cosets of those of a code without redundancy: position
/// 2^rate·j + k of a codeword is position j of coset k.
pub struct Encoder {
    dft: Radix2DitParallel<Theirs>,
    rate: u32,
}

impl Encoder {
    /// For codewords that are 2^`rate` times as long as what is encoded.
    pub fn new(rate: u32) -> Self {
        Self {
            dft: Radix2DitParallel::default(),
            rate,
        }
    }

    pub(super) fn cosets(&self) -> usize {
        1 << self.rate
    }

    /// All cosets, in the order of the leaves with their rows.
    pub(super) fn order(&self) -> impl Iterator<Item = usize> {
        let bits = self.rate;
        (0..1usize << bits).map(move |coset| coset.reverse_bits() >> (usize::BITS - bits))
    }

    /// The codewords of a matrix on one coset, by rows. [`Self::place`] states where each row is. At all points of coset k, x to the power of the
    /// number of rows is the k-th power of one root of unity: so a tail is added to the first coefficients.
    pub(super) fn coset(
        &self,
        mut rows: Vec<Theirs>,
        tails: &[&[Goldilocks]],
        coset: usize,
    ) -> Vec<Theirs> {
        let width = tails.len();
        let factor = Goldilocks::root_of_unity(self.rate).pow(coset as u64);
        for (column, tail) in tails.iter().enumerate() {
            for (value, &coefficient) in rows[column..].iter_mut().step_by(width).zip(*tail) {
                *value += Theirs::new((factor * coefficient).value());
            }
        }
        let bits = (rows.len() / width).ilog2() + self.rate;
        let shift = Goldilocks::root_of_unity(bits).pow(coset as u64);
        self.transform(rows, width, shift)
    }

    /// The polynomials whose coefficients are in the columns of these rows, at the points `shift` times a root of unity, in the order of reversed bits.
    pub(super) fn transform(
        &self,
        rows: Vec<Theirs>,
        width: usize,
        shift: Goldilocks,
    ) -> Vec<Theirs> {
        let matrix = RowMajorMatrix::new(rows, width);
        let codewords = self.dft.coset_dft_batch(matrix, Theirs::new(shift.value()));
        // The rows lie in the order of their reversed bits. To reverse it twice changes nothing.
        codewords.bit_reverse_rows().values
    }

    /// The coset that a position is in, and the row of it, of 2^`bits` rows.
    pub(super) fn place(&self, position: usize, bits: u32) -> (usize, usize) {
        let row = position >> self.rate;
        (
            position % self.cosets(),
            row.reverse_bits() >> (usize::BITS - bits),
        )
    }

    /// The codeword of one column with its tail.
    pub fn encode(&self, values: &[Goldilocks], tail: &[Goldilocks]) -> Vec<Goldilocks> {
        let rows = || {
            values
                .iter()
                .map(|value| Theirs::new(value.value()))
                .collect()
        };
        let cosets = (0..self.cosets()).map(|coset| self.coset(rows(), &[tail], coset));
        let cosets: Vec<Vec<Theirs>> = cosets.collect();
        let bits = values.len().ilog2();
        let value = |position: usize| {
            let (coset, row) = self.place(position, bits);
            ours(&cosets[coset][row])
        };
        (0..values.len() << self.rate).map(value).collect()
    }
}

/// The codeword of one message of the extension.
pub(super) fn encode_extension(
    message: &[Extension],
    tail: &[Extension],
    rate: u32,
) -> Vec<Extension> {
    let encoder = Encoder::new(rate);
    let words = Goldilocks::peel_slice(Extension::coefficients(message));
    let coefficients = || words.iter().map(|&word| Theirs::new(word)).collect();
    let tails = [0, 1].map(|place| {
        tail.iter()
            .map(|element| element.0[place])
            .collect::<Vec<_>>()
    });
    let tails = [&tails[0][..], &tails[1]];
    let cosets: Vec<Vec<Theirs>> = (0..encoder.cosets())
        .map(|coset| encoder.coset(coefficients(), &tails, coset))
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
pub(super) fn fold(codeword: &[Extension], challenge: Extension) -> Vec<Extension> {
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
