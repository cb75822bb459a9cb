//! Values on some axes that are computed where they are read, a block at a time: then nobody has to keep all of them.

use super::values::{SourceValues, BLOCK};
use rayon::prelude::*;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::Arc;

/// Stands for the number of a value that is zero wherever it is read.
pub const NOTHING: usize = usize::MAX;

/// What numbers of values are about.
pub enum Where<'a> {
    /// A source.
    Source(SourceValues<'a>),
    /// What was computed.
    Computed(Arc<Vec<i64>>),
}

impl Where<'_> {
    fn get(&self, number: usize) -> i64 {
        match self {
            Self::Source(values) => values.get(number),
            Self::Computed(values) => values[number],
        }
    }

    /// Adds the values from number `first` on, times `factor`.
    fn add(&self, first: usize, factor: i64, sums: &mut [i64]) {
        match self {
            Self::Source(values) => values.add(first, factor, sums),
            Self::Computed(values) => super::values::add(&values[first..], factor, sums),
        }
    }
}

/// How the numbers of neighbours on the lowest axes differ.
enum RowStride {
    /// They follow each other.
    Beside,
    /// They are the same.
    Same,
    /// By these steps from the first one.
    Any(Vec<usize>),
}

/// A value for each index on some axes: its number is the sum of a step for each axis.
pub struct Gather<'a> {
    from: Where<'a>,
    start: usize,
    factor: i64,
    row: RowStride,
    /// Bits of the number of a value in a row.
    bits: u32,
    /// The steps on the axes above a row.
    above: Vec<Vec<usize>>,
}

impl<'a> Gather<'a> {
    /// Of each axis, from the lowest, the steps of its indices, of which there are a power of two.
    pub fn new(from: Where<'a>, start: usize, factor: i64, steps: Vec<Vec<usize>>) -> Self {
        let mut gather = Self {
            from,
            start,
            factor,
            row: RowStride::Beside,
            bits: 0,
            above: vec![],
        };
        let mut steps = steps
            .into_iter()
            .filter(|steps| steps[..] != [0])
            .peekable();
        while let Some(own) = steps.peek() {
            let all_are = |step: usize| own.iter().enumerate().all(|(n, &own)| own == n * step);
            match gather.row {
                RowStride::Beside if all_are(1 << gather.bits) => {}
                RowStride::Same if all_are(0) => {}
                _ if gather.bits == 0 && all_are(0) => gather.row = RowStride::Same,
                _ => break,
            }
            gather.bits += own.len().ilog2();
            steps.next();
        }
        if gather.bits == 0 {
            if let Some(own) = steps.next() {
                gather.bits = own.len().ilog2();
                gather.row = RowStride::Any(own);
            }
        }
        gather.above = steps.collect();
        gather
    }

    /// All values, if they are a source's int16 as they lie there.
    pub fn as_they_lie(&self, count: usize) -> Option<&'a [i16]> {
        match (&self.from, &self.row) {
            (Where::Source(SourceValues::Narrow(values)), RowStride::Beside)
                if self.above.is_empty() && self.factor == 1 =>
            {
                values.get(self.start..self.start + count)
            }
            _ => None,
        }
    }

    /// The number of a row's first value; none if the row is zero.
    fn row(&self, mut row: usize) -> Option<usize> {
        let mut first = self.start;
        for steps in &self.above {
            match steps[row % steps.len()] {
                NOTHING => return None,
                step => first += step,
            }
            row /= steps.len();
        }
        Some(first)
    }

    /// Adds the values from number `first` on, times `factor`.
    pub fn add(&self, mut first: usize, factor: i64, mut sums: &mut [i64]) {
        let factor = factor.wrapping_mul(self.factor);
        let width = 1usize << self.bits;
        while !sums.is_empty() {
            let inner = first & (width - 1);
            let (now, later) = sums.split_at_mut(sums.len().min(width - inner));
            if let Some(start) = self.row(first >> self.bits) {
                match &self.row {
                    RowStride::Beside => self.from.add(start + inner, factor, now),
                    RowStride::Same => {
                        let value = self.from.get(start).wrapping_mul(factor);
                        now.iter_mut()
                            .for_each(|sum| *sum = sum.wrapping_add(value));
                    }
                    RowStride::Any(steps) => {
                        for (sum, &step) in now.iter_mut().zip(&steps[inner..]) {
                            if step != NOTHING {
                                let value = self.from.get(start + step);
                                *sum = sum.wrapping_add(value.wrapping_mul(factor));
                            }
                        }
                    }
                }
            }
            first += now.len();
            sums = later;
        }
    }
}

/// `Σ coefficient · Π factors`, where each factor is a sum of gathered values.
pub struct GatheredProducts<'a> {
    /// Coefficients and factors.
    pub terms: Vec<(i64, Vec<Vec<Gather<'a>>>)>,
    /// How many values there are.
    pub count: usize,
    /// Each value is a sum over so many, which are `count` apart.
    pub summed: usize,
}

impl GatheredProducts<'_> {
    fn add(&self, first: usize, sums: &mut [i64]) {
        let (mut product, mut factor) = ([0; BLOCK], [0; BLOCK]);
        let (product, factor) = (&mut product[..sums.len()], &mut factor[..sums.len()]);
        for (coefficient, factors) in &self.terms {
            for number in 0..self.summed {
                let first = first + number * self.count;
                product.fill(*coefficient);
                for own in factors {
                    factor.fill(0);
                    own.iter().for_each(|gather| gather.add(first, 1, factor));
                    multiply(product, factor);
                }
                super::values::add(product, 1, sums);
            }
        }
    }
}

fn multiply(values: &mut [i64], factors: &[i64]) {
    for (value, &factor) in values.iter_mut().zip(factors) {
        *value = value.wrapping_mul(factor);
    }
}

/// What a term multiplies.
pub enum What<'a> {
    /// 1.
    One,
    /// A sum of gathered values.
    Gathered(Vec<Gather<'a>>),
    /// Products.
    Products(GatheredProducts<'a>),
}

/// `factor · coefficients · what`.
pub struct GatheredTerm<'a> {
    /// The same everywhere.
    pub factor: i64,
    /// Others, if there are any.
    pub coefficients: Option<Gather<'a>>,
    /// What is multiplied.
    pub what: What<'a>,
}

/// A sum of terms for each index on some axes.
pub struct SumReader<'a>(pub Vec<GatheredTerm<'a>>);

impl SumReader<'_> {
    /// The value, if it is the same everywhere.
    pub fn constant(&self) -> Option<i64> {
        let same = |term: &GatheredTerm| match (&term.what, &term.coefficients) {
            (What::One, None) => Some(term.factor),
            _ => None,
        };
        self.0.iter().map(same).sum()
    }

    /// Writes the values from number `first` on, up to [`BLOCK`] of them.
    pub fn read(&self, first: usize, values: &mut [i64]) {
        values.fill(0);
        for term in &self.0 {
            term.add(first, values);
        }
    }
}

impl GatheredTerm<'_> {
    fn add(&self, first: usize, sums: &mut [i64]) {
        match (&self.what, &self.coefficients) {
            (What::One, None) => {
                for sum in sums {
                    *sum = sum.wrapping_add(self.factor);
                }
            }
            (What::One, Some(coefficients)) => coefficients.add(first, self.factor, sums),
            (What::Gathered(all), None) => {
                all.iter()
                    .for_each(|gather| gather.add(first, self.factor, sums));
            }
            (what, coefficients) => {
                let mut own = [0; BLOCK];
                let own = &mut own[..sums.len()];
                match what {
                    What::One => own.fill(1),
                    What::Gathered(all) => all.iter().for_each(|gather| gather.add(first, 1, own)),
                    What::Products(products) => products.add(first, own),
                }
                if let Some(coefficients) = coefficients {
                    let mut all = [0; BLOCK];
                    let all = &mut all[..sums.len()];
                    coefficients.add(first, 1, all);
                    multiply(own, all);
                }
                super::values::add(own, self.factor, sums);
            }
        }
    }
}

/// All values, which `read` writes from a number on.
pub fn all(count: usize, read: impl Fn(usize, &mut [i64]) + Sync) -> Vec<i64> {
    let mut values = vec![0; count];
    let blocks = values.par_chunks_mut(BLOCK).enumerate();
    blocks.for_each(|(block, values)| read(block * BLOCK, values));
    values
}

/// All values as smaller integers, if all of them fit.
pub fn narrowed<T: TryFrom<i64> + Copy + Default + Send>(
    count: usize,
    read: impl Fn(usize, &mut [i64]) + Sync,
) -> Option<Vec<T>> {
    let fit = AtomicBool::new(true);
    let mut narrowed = vec![T::default(); count];
    let blocks = narrowed.par_chunks_mut(BLOCK).enumerate();
    blocks.for_each(|(block, narrowed)| {
        let mut values = [0; BLOCK];
        let values = &mut values[..narrowed.len()];
        read(block * BLOCK, values);
        let mut all_fit = true;
        for (target, &value) in narrowed.iter_mut().zip(&*values) {
            let value = T::try_from(value);
            all_fit &= value.is_ok();
            *target = value.unwrap_or_default();
        }
        if !all_fit {
            fit.store(false, Ordering::Relaxed);
        }
    });
    fit.into_inner().then_some(narrowed)
}
