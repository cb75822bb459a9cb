//! The fractions of one layer, as the prover reads them.

use crate::field::lazy::{LazyFactor, LazySum};
use crate::field::{Extension, Goldilocks};
use rayon::prelude::*;

/// Fractions that are added.
pub trait Leaves: Sync {
    /// What the numerators are.
    type Numerator: Numerator;

    /// How many there are. All that follow are 0/1, and cost next to nothing.
    fn len(&self) -> usize;

    /// Whether all are 0/1.
    fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Writes the fractions from number `first` on. There are as many as are asked for.
    fn read(
        &self,
        first: usize,
        numerators: &mut [Self::Numerator],
        denominators: &mut [Extension],
    );

    /// Like [`Self::read`], but also for fractions after the last one.
    fn read_padded(
        &self,
        first: usize,
        numerators: &mut [Self::Numerator],
        denominators: &mut [Extension],
    ) {
        let used = self.len().saturating_sub(first).min(numerators.len());
        let (read, padding) = numerators.split_at_mut(used);
        padding.fill(Self::Numerator::default());
        let (denominators, padding) = denominators.split_at_mut(used);
        padding.fill(Extension::ONE);
        self.read(first, read, denominators);
    }
}

impl<L: Leaves> Leaves for &L {
    type Numerator = L::Numerator;

    fn len(&self) -> usize {
        (*self).len()
    }

    fn read(&self, first: usize, numerators: &mut [L::Numerator], denominators: &mut [Extension]) {
        (*self).read(first, numerators, denominators);
    }
}

/// A numerator: of the base field, where all multiplications are cheaper, or of the extension.
pub trait Numerator: Copy + Default + Send + Sync {
    /// The element.
    fn extension(self) -> Extension;
    /// `self − other`.
    fn minus(self, other: Self) -> Self;
    /// Adds `self · factor` to a sum.
    fn add_to(self, sum: &mut LazySum, factor: Extension);
    /// The value between `zero` and `one`.
    fn between(factor: &LazyFactor, zero: Self, one: Self) -> Extension;
}

impl Numerator for Extension {
    #[inline(always)]
    fn extension(self) -> Extension {
        self
    }

    #[inline(always)]
    fn minus(self, other: Self) -> Self {
        self - other
    }

    #[inline(always)]
    fn add_to(self, sum: &mut LazySum, factor: Extension) {
        sum.add(self, factor);
    }

    #[inline(always)]
    fn between(factor: &LazyFactor, zero: Self, one: Self) -> Extension {
        factor.between(zero, one)
    }
}

impl Numerator for Goldilocks {
    #[inline(always)]
    fn extension(self) -> Extension {
        self.into()
    }

    #[inline(always)]
    fn minus(self, other: Self) -> Self {
        self - other
    }

    #[inline(always)]
    fn add_to(self, sum: &mut LazySum, factor: Extension) {
        sum.add_scaled(factor, self);
    }

    #[inline(always)]
    fn between(factor: &LazyFactor, zero: Self, one: Self) -> Extension {
        factor.between_base(zero, one)
    }
}

/// Fractions in memory: numerators and denominators.
pub struct StoredFractions<N> {
    numerators: Vec<N>,
    denominators: Vec<Extension>,
}

impl<N: Numerator> StoredFractions<N> {
    /// These fractions: as many numerators as denominators.
    pub fn new(numerators: Vec<N>, denominators: Vec<Extension>) -> Self {
        assert_eq!(numerators.len(), denominators.len());
        Self {
            numerators,
            denominators,
        }
    }
}

impl<N: Numerator> Leaves for StoredFractions<N> {
    type Numerator = N;

    fn len(&self) -> usize {
        self.numerators.len()
    }

    fn read(&self, first: usize, numerators: &mut [N], denominators: &mut [Extension]) {
        let range = first..first + numerators.len();
        numerators.copy_from_slice(&self.numerators[range.clone()]);
        denominators.copy_from_slice(&self.denominators[range]);
    }
}

/// The sum of two fractions.
#[inline(always)]
fn sum<N: Numerator>(p: &[N; 2], q: &[Extension; 2]) -> (Extension, Extension) {
    let mut sum = LazySum::default();
    p[0].add_to(&mut sum, q[1]);
    p[1].add_to(&mut sum, q[0]);
    (sum.reduce(), q[0] * q[1])
}

/// The fractions of the next layer, sums of two each, which are computed whenever they are read: to write them to fresh memory and to read
/// them back takes as long.
pub struct Parents<'a, L>(pub &'a L);

/// Fractions that are added at once.
const ADDED: usize = 1 << 8;

impl<L: Leaves> Leaves for Parents<'_, L> {
    type Numerator = Extension;

    fn len(&self) -> usize {
        self.0.len().div_ceil(2)
    }

    fn read(&self, first: usize, numerators: &mut [Extension], denominators: &mut [Extension]) {
        let mut p = [L::Numerator::default(); ADDED];
        let mut q = [Extension::ONE; ADDED];
        let blocks = numerators.chunks_mut(ADDED / 2);
        let blocks = blocks.zip(denominators.chunks_mut(ADDED / 2)).enumerate();
        for (block, (numerators, denominators)) in blocks {
            let count = 2 * numerators.len();
            let (p, q) = (&mut p[..count], &mut q[..count]);
            self.0.read_padded(2 * first + block * ADDED, p, q);
            let pairs = p.as_chunks().0.iter().zip(q.as_chunks().0);
            let targets = numerators.iter_mut().zip(denominators);
            for (target, (p, q)) in targets.zip(pairs) {
                (*target.0, *target.1) = sum(p, q);
            }
        }
    }
}

/// Fractions of a piece.
const PIECE: usize = 1 << 11;

/// Computed fractions, in pieces. Pieces are small enough for the allocator to use their memory again at once: a fresh page from the system
/// costs more than what is computed in it.
pub struct Pieces(Vec<(Vec<Extension>, Vec<Extension>)>);

impl Pieces {
    /// The fractions of the next layer: sums of two each.
    pub fn parents(leaves: &impl Leaves) -> Self {
        let count = leaves.len().div_ceil(2).max(1);
        let pieces = (0..count.div_ceil(PIECE)).into_par_iter();
        let pieces = pieces.map_init(FractionBuffer::default, |block, number| {
            let first = number * PIECE;
            let (p, q) = block.read(leaves, 2 * first, 2 * PIECE.min(count - first));
            let pairs = p.as_chunks().0.iter().zip(q.as_chunks().0);
            pairs.map(|(p, q)| sum(p, q)).unzip()
        });
        Self(pieces.collect())
    }
}

impl Leaves for Pieces {
    type Numerator = Extension;

    fn len(&self) -> usize {
        let last = self.0.last().map_or(0, |(p, _)| p.len());
        self.0.len().saturating_sub(1) * PIECE + last
    }

    fn read(
        &self,
        mut first: usize,
        mut numerators: &mut [Extension],
        mut denominators: &mut [Extension],
    ) {
        while !numerators.is_empty() {
            let (p, q) = &self.0[first / PIECE];
            let start = first % PIECE;
            let count = numerators.len().min(PIECE - start);
            let (now, later) = numerators.split_at_mut(count);
            now.copy_from_slice(&p[start..start + count]);
            numerators = later;
            let (now, later) = denominators.split_at_mut(count);
            now.copy_from_slice(&q[start..start + count]);
            denominators = later;
            first += count;
        }
    }
}

/// Room for fractions that are read.
pub struct FractionBuffer<N>(Vec<N>, Vec<Extension>);

impl<N> Default for FractionBuffer<N> {
    fn default() -> Self {
        Self(vec![], vec![])
    }
}

impl<N: Numerator> FractionBuffer<N> {
    /// Reads `count` fractions.
    pub fn read<L: Leaves<Numerator = N>>(
        &mut self,
        leaves: &L,
        first: usize,
        count: usize,
    ) -> (&[N], &[Extension]) {
        self.0.resize(count, N::default());
        self.1.resize(count, Extension::ONE);
        leaves.read_padded(first, &mut self.0, &mut self.1);
        (&self.0, &self.1)
    }
}
