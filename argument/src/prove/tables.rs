//! All values of tensors that nobody commits to.

use super::values::Values;
use crate::relation::{Atom, Axis, Factor, Index, Linear, Relations, View};
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, PoisonError};

/// Sums of products that were computed before, by the numbers of products and of monomials. They take long, and several relations need
/// each. They are right as long as the values do not change that they are made from.
#[derive(Default)]
pub struct Computed(Mutex<BTreeMap<Factor, Arc<Vec<i64>>>>);

impl Computed {
    fn get(&self, which: Factor, compute: impl FnOnce() -> Vec<i64>) -> Arc<Vec<i64>> {
        let known = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(known) = known.get(&which) {
            return known.clone();
        }
        drop(known);
        let values = Arc::new(compute());
        let mut known = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        known.insert(which, values.clone());
        values
    }
}

/// Computes values from those of the sources.
#[derive(Clone, Copy)]
pub struct Tables<'a> {
    /// The relations.
    pub relations: &'a Relations,
    /// The values of each source.
    pub sources: &'a [Values<'a>],
    /// What was computed before.
    pub computed: &'a Computed,
}

impl Tables<'_> {
    /// The values of a virtual tensor on `axes`, which are all that it reads, and others along which its values repeat.
    pub fn of_virtual(&self, number: usize, axes: &[Axis]) -> Vec<i64> {
        let mut sum = vec![0; 1 << self.relations.size(axes)];
        for view in &self.relations.virtuals[number].views {
            self.add_view(view, axes, &mut sum);
        }
        sum
    }

    fn add_view(&self, view: &View, axes: &[Axis], sum: &mut [i64]) {
        let tensor = &self.relations.tensors[view.tensor];
        let values = self.sources[tensor.source.0 as usize];
        // For each axis and index, how far into the tensor it leads; nothing where the view is zero.
        let mut steps: Vec<Vec<Option<usize>>> = axes
            .iter()
            .map(|&axis| vec![Some(0); 1 << self.relations.bits(axis)])
            .collect();
        let of = |axis: Axis| axes.iter().position(|&own| own == axis);
        let mut start = tensor.offset;
        for (index, place) in view.indices.iter().zip(&tensor.places) {
            let shift = place.shift;
            let (axis, map) = match *index {
                Index::Of(axis) => (axis, None),
                Index::Mapped(axis, map) => (axis, Some(&self.relations.maps[map])),
                Index::Fixed(fixed) => {
                    start += fixed << shift;
                    continue;
                }
            };
            if let Some(own) = of(axis) {
                for (number, step) in steps[own].iter_mut().enumerate() {
                    let place = match map {
                        None => Some(number),
                        Some(map) => map[number].map(usize::from),
                    };
                    *step = place.and_then(|place| step.map(|step| step + (place << shift)));
                }
            }
        }
        for &(axis, only) in &view.only {
            let Some(own) = of(axis) else { continue };
            for (number, step) in steps[own].iter_mut().enumerate() {
                *step = step.filter(|_| number == only);
            }
        }
        let (lowest, higher) = match steps.split_first() {
            Some(split) => split,
            None => {
                sum[0] += view.factor * values.get(start);
                return;
            }
        };
        sum.par_chunks_exact_mut(lowest.len())
            .enumerate()
            .for_each(|(mut row, sums)| {
                let mut first = start;
                for steps in higher {
                    match steps[row % steps.len()] {
                        Some(step) => first += step,
                        None => return,
                    }
                    row /= steps.len();
                }
                for (sum, step) in sums.iter_mut().zip(lowest) {
                    if let Some(step) = step {
                        *sum += view.factor * values.get(first + step);
                    }
                }
            });
    }

    /// The axes of a product, from the lowest: those of the left factor, those of the right one, those of both.
    pub fn product_axes(&self, number: usize) -> Vec<Axis> {
        let product = &self.relations.products[number];
        [&product.left_axes[..], &product.right_axes, &product.shared].concat()
    }

    /// The values of a product on its own axes.
    fn product(&self, number: usize) -> Arc<Vec<i64>> {
        self.computed
            .get(Factor::Product(number), || self.multiply(number))
    }

    fn multiply(&self, number: usize) -> Vec<i64> {
        let product = &self.relations.products[number];
        let table = |factor: usize, own: &[Axis]| {
            self.of_virtual(factor, &[&product.summed, own, &product.shared].concat())
        };
        let left = table(product.left, &product.left_axes);
        let right = table(product.right, &product.right_axes);
        let summed = 1 << self.relations.size(&product.summed);
        let lefts = 1 << self.relations.size(&product.left_axes);
        let rights = 1 << self.relations.size(&product.right_axes);
        match (narrow(&left), narrow(&right)) {
            (Some(left), Some(right)) => {
                products(&left, &right, [summed, lefts, rights], dot_narrow)
            }
            _ => products(&left, &right, [summed, lefts, rights], dot),
        }
    }

    /// The values of monomials on those of their axes that are not summed over.
    pub fn monomials(&self, number: usize) -> Vec<i64> {
        let monomials = &self.relations.monomials[number];
        let axes = &monomials.axes;
        let kept = &axes[..axes.len() - monomials.summed];
        let mut sums = vec![0i64; 1 << self.relations.size(kept)];
        for (coefficient, factors) in &monomials.terms {
            let mut products = vec![*coefficient; 1 << self.relations.size(axes)];
            for &factor in factors {
                let values = self.factor(factor, axes);
                let pairs = products.par_iter_mut().zip(values);
                pairs.for_each(|(product, value)| *product = product.wrapping_mul(value));
            }
            for row in products.chunks_exact(sums.len()) {
                let pairs = sums.par_iter_mut().zip(row);
                pairs.for_each(|(sum, &value)| *sum = sum.wrapping_add(value));
            }
        }
        sums
    }

    /// The values of a factor on these axes.
    pub fn factor(&self, factor: Factor, axes: &[Axis]) -> Vec<i64> {
        match factor {
            Factor::Virtual(number) => self.of_virtual(number, axes),
            Factor::Product(number) => {
                self.repeat(&self.product(number), &self.product_axes(number), axes)
            }
            Factor::Public(number) => self.public(number, axes),
        }
    }

    /// The values of a public tensor on these axes.
    pub fn public(&self, number: usize, axes: &[Axis]) -> Vec<i64> {
        let public = &self.relations.publics[number];
        let own = public.axes();
        let sizes: Vec<usize> = own
            .iter()
            .map(|&axis| 1 << self.relations.bits(axis))
            .collect();
        let values = (0..1usize << self.relations.size(own)).into_par_iter();
        let value = |mut place: usize| {
            let indices: Vec<usize> = sizes
                .iter()
                .map(|&size| {
                    let index = place % size;
                    place /= size;
                    index
                })
                .collect();
            integer(public.value(&indices))
        };
        let values: Vec<i64> = values.map(value).collect();
        self.repeat(&values, own, axes)
    }

    /// Values that lie on the axes `own`, on `axes`.
    fn repeat(&self, values: &[i64], own: &[Axis], axes: &[Axis]) -> Vec<i64> {
        if own == axes {
            return values.to_vec();
        }
        let mut stride = 1;
        let mut strides = vec![0; axes.len()];
        for &axis in own {
            if let Some(place) = axes.iter().position(|&of| of == axis) {
                strides[place] = stride;
            }
            stride <<= self.relations.bits(axis);
        }
        let sizes: Vec<usize> = axes
            .iter()
            .map(|&axis| 1 << self.relations.bits(axis))
            .collect();
        let places = (0..1usize << self.relations.size(axes)).into_par_iter();
        let value = |mut place: usize| {
            let mut from = 0;
            for (stride, size) in strides.iter().zip(&sizes) {
                from += place % size * stride;
                place /= size;
            }
            values[from]
        };
        places.map(value).collect()
    }

    /// The values of a sum of terms on these axes.
    pub fn linear(&self, linear: &Linear, axes: &[Axis]) -> Vec<i64> {
        let mut sums = vec![0i64; 1 << self.relations.size(axes)];
        for term in linear {
            let values = match term.atom {
                Atom::One => vec![1; sums.len()],
                Atom::Virtual(number) => self.of_virtual(number, axes),
                Atom::Product(number) => self.factor(Factor::Product(number), axes),
                Atom::Public(number) => self.public(number, axes),
                Atom::Monomials(number) => {
                    let monomials = &self.relations.monomials[number];
                    let kept = &monomials.axes[..monomials.axes.len() - monomials.summed];
                    self.repeat(&self.monomials(number), kept, axes)
                }
                Atom::Summed(number) => {
                    let summed = &self.relations.sums[number];
                    let all = [&summed.axes, axes].concat();
                    let each = self.of_virtual(summed.of, &all);
                    let rows = each.par_chunks_exact(1 << self.relations.size(&summed.axes));
                    rows.map(|row| row.iter().sum()).collect()
                }
            };
            let coefficients = term.coefficients.map(|number| {
                let (axis, coefficients) = &self.relations.coefficients[number];
                let values: Vec<i64> = coefficients.iter().map(|&c| integer(c)).collect();
                self.repeat(&values, &[*axis], axes)
            });
            let terms = sums.par_iter_mut().zip(values).enumerate();
            terms.for_each(|(index, (sum, value))| {
                let coefficient = coefficients.as_ref().map_or(1, |all| all[index]);
                let value = value.wrapping_mul(coefficient).wrapping_mul(term.factor);
                *sum = sum.wrapping_add(value);
            });
        }
        sums
    }
}

/// The values as int16, if all are.
fn narrow(values: &[i64]) -> Option<Vec<i16>> {
    let narrowed = values.par_iter().map(|&value| i16::try_from(value).ok());
    narrowed.collect()
}

/// Of each block the products of all rows of the left factor with all rows of the right one.
fn products<T: Sync>(
    left: &[T],
    right: &[T],
    [summed, lefts, rights]: [usize; 3],
    dot: fn(&[T], &[T]) -> i64,
) -> Vec<i64> {
    let rows = right.par_chunks_exact(summed).enumerate();
    let sums = rows.flat_map_iter(|(row, b)| {
        let block = &left[row / rights * summed * lefts..][..summed * lefts];
        block.chunks_exact(summed).map(move |a| dot(a, b))
    });
    sums.collect()
}

/// `Σ a·b`.
fn dot_narrow(a: &[i16], b: &[i16]) -> i64 {
    // A product fits an i32. A sum of two may not.
    a.iter()
        .zip(b)
        .map(|(&a, &b)| (a as i32 * b as i32) as i64)
        .sum()
}

/// `Σ a·b`.
fn dot(a: &[i64], b: &[i64]) -> i64 {
    let terms = a.iter().zip(b);
    terms.fold(0, |sum, (&a, &b)| sum.wrapping_add(a.wrapping_mul(b)))
}

/// The integer of least magnitude that an element stands for.
fn integer(element: crate::field::Goldilocks) -> i64 {
    const P: u64 = crate::field::goldilocks::P;
    let value = element.value();
    match value > P / 2 {
        true => -((P - value) as i64),
        false => value as i64,
    }
}
