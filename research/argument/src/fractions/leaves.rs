//! The fractions of one layer, as the prover reads them.

use crate::field::lazy::{Factor, Sum};
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

/// A numerator: of the base field, where all multiplications are cheaper, or of the extension.
pub trait Numerator: Copy + Default + Send + Sync {
    /// The element.
    fn extension(self) -> Extension;
    /// `self − other`.
    fn minus(self, other: Self) -> Self;
    /// Adds `self · factor` to a sum.
    fn add_to(self, sum: &mut Sum, factor: Extension);
    /// The value between `zero` and `one`.
    fn between(factor: &Factor, zero: Self, one: Self) -> Extension;
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
    fn add_to(self, sum: &mut Sum, factor: Extension) {
        sum.add(self, factor);
    }

    #[inline(always)]
    fn between(factor: &Factor, zero: Self, one: Self) -> Extension {
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
    fn add_to(self, sum: &mut Sum, factor: Extension) {
        sum.add_scaled(factor, self);
    }

    #[inline(always)]
    fn between(factor: &Factor, zero: Self, one: Self) -> Extension {
        factor.between_base(zero, one)
    }
}

/// Fractions in memory: numerators and denominators.
pub struct Stored<N> {
    numerators: Vec<N>,
    denominators: Vec<Extension>,
}

impl<N: Numerator> Stored<N> {
    /// These fractions: as many numerators as denominators.
    pub fn new(numerators: Vec<N>, denominators: Vec<Extension>) -> Self {
        assert_eq!(numerators.len(), denominators.len());
        Self {
            numerators,
            denominators,
        }
    }
}

impl<N: Numerator> Leaves for Stored<N> {
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

/// Fractions that are read at once.
const BLOCK: usize = 1 << 11;

/// The fractions of the next layer: sums of two each.
pub fn parents(leaves: &impl Leaves) -> Stored<Extension> {
    let count = leaves.len().div_ceil(2);
    let mut numerators = vec![Extension::ZERO; count];
    let mut denominators = vec![Extension::ONE; count];
    let blocks = numerators.par_chunks_mut(BLOCK / 2);
    let blocks = blocks.zip(denominators.par_chunks_mut(BLOCK / 2));
    blocks.enumerate().for_each_init(
        Block::default,
        |block, (number, (numerators, denominators))| {
            let (p, q) = block.read(leaves, number * BLOCK, 2 * numerators.len());
            let pairs = p.as_chunks::<2>().0.iter().zip(q.as_chunks::<2>().0);
            let sums = numerators.iter_mut().zip(denominators).zip(pairs);
            for ((numerator, denominator), (p, q)) in sums {
                let mut sum = Sum::default();
                p[0].add_to(&mut sum, q[1]);
                p[1].add_to(&mut sum, q[0]);
                *numerator = sum.reduce();
                *denominator = q[0] * q[1];
            }
        },
    );
    Stored::new(numerators, denominators)
}

/// Room for fractions that are read.
pub struct Block<N>(Vec<N>, Vec<Extension>);

impl<N> Default for Block<N> {
    fn default() -> Self {
        Self(vec![], vec![])
    }
}

impl<N: Numerator> Block<N> {
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
