//! All values of tensors that nobody commits to.

use super::reading::{
    all, narrowed, Gather, GatheredProducts, GatheredTerm, SumReader, What, Where, NOTHING,
};
use super::values::{SourceValues, BLOCK};
use crate::relation::along::Along;
use crate::relation::{self, Atom, Axis, Factor, Index, LinearSum, Relations, View};
use rayon::prelude::*;
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, PoisonError};

/// Products and public tensors that were computed before. They take long, and several relations need each. They are right as long as the values
/// do not change that they are made from.
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
    pub sources: &'a [SourceValues<'a>],
    /// What was computed before.
    pub computed: &'a Computed,
}

impl<'a> Tables<'a> {
    /// The values of a sum of terms on these axes.
    pub fn linear(&self, linear: &LinearSum, axes: &[Axis]) -> Vec<i64> {
        self.all(axes, &self.reader(linear, axes))
    }

    /// The values of a virtual tensor on `axes`, which are all that it reads, and others along which its values repeat.
    pub fn of_virtual(&self, number: usize, axes: &[Axis]) -> Vec<i64> {
        self.factor(Factor::Virtual(number), axes)
    }

    /// The values of a public tensor on these axes.
    pub fn public(&self, number: usize, axes: &[Axis]) -> Vec<i64> {
        self.factor(Factor::Public(number), axes)
    }

    /// The values of a factor on these axes.
    pub fn factor(&self, factor: Factor, axes: &[Axis]) -> Vec<i64> {
        let what = What::Gathered(self.gather(factor, axes));
        self.all(axes, &SumReader(vec![once(what)]))
    }

    /// The values of monomials on those of their axes that are not summed over.
    pub fn monomials(&self, number: usize) -> Vec<i64> {
        let what = What::Products(self.products_of(number));
        self.all(self.monomial_axes(number), &SumReader(vec![once(what)]))
    }

    fn all(&self, axes: &[Axis], reader: &SumReader<'_>) -> Vec<i64> {
        let count = 1 << self.relations.size(axes);
        all(count, |first, values| reader.read(first, values))
    }

    /// Reads the values of a sum of terms on these axes.
    pub fn reader(&self, linear: &LinearSum, axes: &[Axis]) -> SumReader<'a> {
        let terms = linear.iter().map(|term| {
            let what = match term.atom {
                Atom::One => What::One,
                Atom::Virtual(number) => What::Gathered(self.gather(Factor::Virtual(number), axes)),
                Atom::Product(number) => What::Gathered(self.gather(Factor::Product(number), axes)),
                Atom::Public(number) => What::Gathered(self.gather(Factor::Public(number), axes)),
                Atom::Monomials(number) if self.monomial_axes(number) == axes => {
                    What::Products(self.products_of(number))
                }
                Atom::Monomials(number) => {
                    let values = Arc::new(self.monomials(number));
                    What::Gathered(vec![self.repeated(
                        values,
                        self.monomial_axes(number),
                        axes,
                    )])
                }
                Atom::Summed(number) => {
                    let summed = &self.relations.sums[number];
                    let all = [axes, &summed.axes].concat();
                    let factor = self.gather(Factor::Virtual(summed.of), &all);
                    What::Products(GatheredProducts {
                        terms: vec![(1, vec![factor])],
                        count: 1 << self.relations.size(axes),
                        summed: 1 << self.relations.size(&summed.axes),
                    })
                }
            };
            let coefficients = term.coefficients.map(|number| {
                let (axis, coefficients) = &self.relations.coefficients[number];
                let values = coefficients.iter().map(|&c| integer(c)).collect();
                self.repeated(Arc::new(values), &[*axis], axes)
            });
            GatheredTerm {
                factor: term.factor,
                coefficients,
                what,
            }
        });
        SumReader(terms.collect())
    }

    /// Reads the values of an atom on these axes.
    pub fn atom(&self, atom: Atom, axes: &[Axis]) -> SumReader<'a> {
        let term = relation::Term {
            factor: 1,
            coefficients: None,
            atom,
        };
        self.reader(&vec![term], axes)
    }

    /// Reads numbers that may differ along an axis.
    pub fn along(&self, numbers: &Along, axes: &[Axis]) -> SumReader<'a> {
        SumReader(vec![match numbers {
            Along::Everywhere(number) => GatheredTerm {
                factor: *number,
                coefficients: None,
                what: What::One,
            },
            Along::Axis(axis, numbers) => {
                let numbers = Arc::new(numbers.clone());
                once(What::Gathered(vec![self.repeated(numbers, &[*axis], axes)]))
            }
        }])
    }

    /// The axes of monomials, but for those that are summed over.
    fn monomial_axes(&self, number: usize) -> &'a [Axis] {
        let monomials = &self.relations.monomials[number];
        &monomials.axes[..monomials.axes.len() - monomials.summed]
    }

    fn products_of(&self, number: usize) -> GatheredProducts<'a> {
        let monomials = &self.relations.monomials[number];
        let kept = self.relations.size(self.monomial_axes(number));
        let terms = monomials.terms.iter().map(|(coefficient, factors)| {
            let factors = factors.iter();
            let factors = factors.map(|&factor| self.gather(factor, &monomials.axes));
            (*coefficient, factors.collect())
        });
        GatheredProducts {
            terms: terms.collect(),
            count: 1 << kept,
            summed: 1 << (self.relations.size(&monomials.axes) - kept),
        }
    }

    /// A factor's values on these axes are sums of these.
    fn gather(&self, factor: Factor, axes: &[Axis]) -> Vec<Gather<'a>> {
        match factor {
            Factor::Virtual(number) => {
                let views = self.relations.virtuals[number].views.iter();
                views.map(|view| self.view(view, axes)).collect()
            }
            Factor::Product(number) => {
                let values = self.computed.get(factor, || self.multiply(number));
                vec![self.repeated(values, &self.product_axes(number), axes)]
            }
            Factor::Public(number) => {
                let values = self.computed.get(factor, || self.write_out(number));
                vec![self.repeated(values, self.relations.publics[number].axes(), axes)]
            }
        }
    }

    fn view(&self, view: &View, axes: &[Axis]) -> Gather<'a> {
        let tensor = &self.relations.tensors[view.tensor];
        // For each axis and index, how far into the tensor it leads.
        let steps = axes
            .iter()
            .map(|&axis| vec![0; 1 << self.relations.bits(axis)]);
        let mut steps: Vec<Vec<usize>> = steps.collect();
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
            let Some(own) = of(axis) else { continue };
            for (number, step) in steps[own].iter_mut().enumerate() {
                let place = match map {
                    None => Some(number),
                    Some(map) => map[number].map(usize::from),
                };
                *step = match (place, *step) {
                    (None, _) | (_, NOTHING) => NOTHING,
                    (Some(place), step) => step + (place << shift),
                };
            }
        }
        for &(axis, only) in &view.only {
            let Some(own) = of(axis) else { continue };
            for (number, step) in steps[own].iter_mut().enumerate() {
                if number != only {
                    *step = NOTHING;
                }
            }
        }
        let values = self.sources[tensor.source.0 as usize];
        Gather::new(Where::Source(values), start, view.factor, steps)
    }

    /// Values that lie on the axes `own`, on `axes`.
    fn repeated(&self, values: Arc<Vec<i64>>, own: &[Axis], axes: &[Axis]) -> Gather<'a> {
        let stride = |axis: Axis| {
            let place = own.iter().position(|&of| of == axis)?;
            Some(1 << self.relations.size(&own[..place]))
        };
        let steps = axes.iter().map(|&axis| {
            let stride: usize = stride(axis).unwrap_or(0);
            (0..1 << self.relations.bits(axis))
                .map(|index: usize| index * stride)
                .collect()
        });
        Gather::new(Where::Computed(values), 0, 1, steps.collect())
    }

    /// All values of a public tensor.
    fn write_out(&self, number: usize) -> Vec<i64> {
        let public = &self.relations.publics[number];
        let sizes = public
            .axes()
            .iter()
            .map(|&axis| 1usize << self.relations.bits(axis));
        let sizes: Vec<usize> = sizes.collect();
        let mut values = vec![0; sizes.iter().product()];
        let blocks = values.par_chunks_mut(BLOCK).enumerate();
        blocks.for_each(|(block, values)| {
            let mut indices = vec![0; sizes.len()];
            for (number, value) in values.iter_mut().enumerate() {
                let mut rest = block * BLOCK + number;
                for (index, &size) in indices.iter_mut().zip(&sizes) {
                    (*index, rest) = (rest % size, rest / size);
                }
                *value = integer(public.value(&indices));
            }
        });
        values
    }

    /// The axes of a product, from the lowest: those of the left factor, those of the right one, those of both.
    fn product_axes(&self, number: usize) -> Vec<Axis> {
        let product = &self.relations.products[number];
        [&product.left_axes[..], &product.right_axes, &product.shared].concat()
    }

    fn multiply(&self, number: usize) -> Vec<i64> {
        let product = &self.relations.products[number];
        let side = |factor: usize, own: &[Axis]| {
            let axes = [&product.summed, own, &product.shared].concat();
            (
                self.gather(Factor::Virtual(factor), &axes),
                1usize << self.relations.size(&axes),
            )
        };
        let (left, lefts) = side(product.left, &product.left_axes);
        let (right, rights) = side(product.right, &product.right_axes);
        let size = |axes: &[Axis]| 1 << self.relations.size(axes);
        let sizes =
            [&product.summed, &product.left_axes, &product.right_axes].map(|axes| size(axes));
        match (narrow(&left, lefts), narrow(&right, rights)) {
            (Some(left), Some(right)) => products(&left, &right, sizes, dot_narrow),
            _ => {
                let [left, right] =
                    [(&left, lefts), (&right, rights)].map(|(of, count)| all(count, sums_of(of)));
                products(&left, &right, sizes, dot)
            }
        }
    }
}

/// `what`, once.
fn once(what: What<'_>) -> GatheredTerm<'_> {
    GatheredTerm {
        factor: 1,
        coefficients: None,
        what,
    }
}

/// Sums of gathered values as int16, if all are.
fn narrow<'a>(gathered: &[Gather<'a>], count: usize) -> Option<Cow<'a, [i16]>> {
    let as_they_lie = match gathered {
        [only] => only.as_they_lie(count),
        _ => None,
    };
    as_they_lie
        .map(Cow::from)
        .or_else(|| narrowed(count, sums_of(gathered)).map(Cow::from))
}

/// Writes sums of gathered values.
fn sums_of<'a>(gathered: &'a [Gather<'_>]) -> impl Fn(usize, &mut [i64]) + Sync + 'a {
    |first, values| {
        values.fill(0);
        gathered.iter().for_each(|own| own.add(first, 1, values));
    }
}

/// Of each block the products of all rows of the left factor with all rows of the right one. Much is padding, with zeros.
fn products<T: Copy + Default + PartialEq + Sync>(
    left: &[T],
    right: &[T],
    [summed, lefts, rights]: [usize; 3],
    dot: fn(&[T], &[T]) -> i64,
) -> Vec<i64> {
    let used = |row: &[T]| row.iter().rposition(|&value| value != T::default());
    // Of each block the rows of the left factor that are not zero, and how many columns they have.
    let blocks = left.par_chunks_exact(summed * lefts).map(|block| {
        let rows = block.chunks_exact(summed).map(used).enumerate();
        let rows: Vec<_> = rows
            .filter_map(|(row, last)| Some((row, last? + 1)))
            .collect();
        let columns = rows.iter().map(|(_, columns)| *columns).max().unwrap_or(0);
        (rows, columns)
    });
    let blocks: Vec<_> = blocks.collect();
    let mut sums = vec![0; blocks.len() * lefts * rights];
    let rows = sums
        .par_chunks_exact_mut(lefts)
        .zip(right.par_chunks_exact(summed));
    rows.enumerate().for_each(|(number, (sums, row))| {
        let block = number / rights;
        let (rows, columns) = &blocks[block];
        let row = &row[..*columns];
        let left = &left[block * summed * lefts..];
        if row.iter().any(|&value| value != T::default()) {
            for &(number, _) in rows {
                sums[number] = dot(&left[number * summed..][..*columns], row);
            }
        }
    });
    sums
}

/// `Σ a·b`.
fn dot_narrow(a: &[i16], b: &[i16]) -> i64 {
    let ((a, a_rest), (b, b_rest)) = (a.as_chunks::<2>(), b.as_chunks::<2>());
    let pairs = a.iter().zip(b).map(|(&[a, c], &[b, d])| {
        // Processors have one instruction for it. All such sums fit an i32 but that of two squares of −2^15, which becomes −2^31, and no other sum does.
        let sum = (a as i32 * b as i32).wrapping_add(c as i32 * d as i32);
        i64::from(sum.wrapping_sub(1)) + 1
    });
    let rest = a_rest.iter().zip(b_rest);
    pairs.sum::<i64>() + rest.map(|(&a, &b)| a as i64 * b as i64).sum::<i64>()
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
    if value > P / 2 {
        -((P - value) as i64)
    } else {
        value as i64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sums_of_the_largest_products_are_exact() {
        const LEAST: i64 = i16::MIN as i64;
        for length in [1, 2, 7, 64] {
            let least = vec![i16::MIN; length];
            let most = vec![i16::MAX; length];
            let expected = length as i64 * LEAST;
            assert_eq!(dot_narrow(&least, &least), expected * LEAST);
            assert_eq!(dot_narrow(&least, &most), expected * i64::from(i16::MAX));
        }
    }
}
