//! The tables that a sumcheck is about, of one instance after the other.

use super::grid::Grid;
use super::instance::Instance;
use super::joined::{Joined, MultilinearTable};
use super::tables::Tables;
use super::values::contract;
use crate::commitment::prove::columns::Column;
use crate::field::{Extension, Goldilocks};
use crate::multilinear::outer;
use crate::relation::{Axis, Factor, Index, Monomials, PartId, Parts, Relations};
use crate::weights::PointWeights;
use rayon::prelude::*;
use std::io;
use std::path::Path;

/// The parts of all axes but that of instances, and the weights of instances: 1 where there is no such axis.
pub fn own_weights(
    relations: &Relations,
    parts: &Parts,
    weights: &PointWeights,
) -> (Vec<PartId>, Vec<Extension>) {
    let (over, own): (Vec<_>, Vec<_>) = weights
        .iter()
        .partition(|(axis, _)| relations.are_instances(*axis));
    let over = over.first().map(|(_, id)| parts.get(*id).weights());
    let over = over.map_or(vec![Extension::ONE], |weights| weights.to_vec());
    (own.into_iter().map(|(_, id)| id).collect(), over)
}

/// The two factors of a product's sum with weights, over the axes that both have. The left one has the weights of these axes.
pub struct ProductFactors {
    /// Of each instance, if both have that axis; otherwise once.
    all: Vec<[Vec<Extension>; 2]>,
}

impl ProductFactors {
    /// Computes them.
    pub fn new(
        relations: &Relations,
        instances: &[Instance<'_>],
        parts: &Parts,
        number: usize,
        weights: &PointWeights,
    ) -> Self {
        let product = &relations.products[number];
        let ids = |axes: &[Axis]| -> Vec<PartId> {
            let own = axes.iter().filter(|axis| !relations.are_instances(**axis));
            own.map(|&axis| weights.part(axis)).collect()
        };
        let (_, over) = own_weights(relations, parts, weights);
        let factor = |instance: &Instance, of: usize, own: &[Axis]| {
            let axes = [own, &product.shared, &product.summed].concat();
            let values = instance.with(|tables| tables.of_virtual(of, &axes));
            contract(&values, parts, &ids(own))
        };
        let mut shared = vec![Extension::ONE];
        for id in ids(&product.shared) {
            shared = outer(&shared, &parts.get(id).weights());
        }
        let of = |axes: &[Axis]| axes.iter().any(|&axis| relations.are_instances(axis));
        let sides = [
            (product.left, &product.left_axes),
            (product.right, &product.right_axes),
        ];
        let mut all = if of(&product.shared) {
            let all = instances.iter().zip(&over).map(|(instance, &weight)| {
                let [mut left, right] = sides.map(|(of, own)| factor(instance, of, own));
                left.par_iter_mut().for_each(|value| *value *= weight);
                [left, right]
            });
            all.collect()
        } else {
            // At most one of the factors has the axis of instances, which is summed over with weights.
            let side = |(number, own): (usize, &Vec<Axis>)| {
                if !of(own) {
                    return factor(&instances[0], number, own);
                }
                let mut sums: Vec<Extension> = vec![];
                for (instance, &weight) in instances.iter().zip(&over) {
                    let values = factor(instance, number, own);
                    sums.resize(values.len(), Extension::ZERO);
                    let pairs = sums.par_iter_mut().zip(values);
                    pairs.for_each(|(sum, value)| *sum += weight * value);
                }
                sums
            };
            vec![sides.map(side)]
        };
        for [left, _] in &mut all {
            left.par_chunks_exact_mut(shared.len()).for_each(|row| {
                for (value, &weight) in row.iter_mut().zip(&shared) {
                    *value *= weight;
                }
            });
        }
        Self { all }
    }

    /// The sum of all products.
    pub fn total(&self) -> Extension {
        let total = |[left, right]: &[Vec<Extension>; 2]| {
            let terms = left.par_iter().zip(right).map(|(&a, &b)| a * b);
            terms.reduce(|| Extension::ZERO, |a, b| a + b)
        };
        self.all.iter().map(total).sum()
    }

    /// The sum as a polynomial in the variables of instances.
    pub fn grid(&self, variables: usize) -> Grid {
        let side = |side: usize| self.all.iter().map(move |factors| &factors[side][..]);
        let factors = [0, 1].map(|number| side(number).collect::<Vec<_>>());
        Grid::of_tables(variables, &[Extension::ONE], &factors, &[(1, vec![0, 1])])
    }

    /// Both factors, where the variables of instances are at a point with these values of eq.
    pub fn at(mut self, at: &[Extension]) -> [Vec<Extension>; 2] {
        if self.all.len() == 1 {
            return self.all.swap_remove(0);
        }
        let mut sums = [0, 1].map(|side| vec![Extension::ZERO; self.all[0][side].len()]);
        for (factors, &weight) in self.all.iter().zip(at) {
            for (sums, values) in sums.iter_mut().zip(factors) {
                let pairs = sums.par_iter_mut().zip(values);
                pairs.for_each(|(sum, &value)| *sum += weight * value);
            }
        }
        sums
    }
}

/// The factors of monomials, each once, and for each term the numbers of its own.
fn factors_of(monomials: &Monomials) -> (Vec<Factor>, Vec<(i64, Vec<usize>)>) {
    let mut known: Vec<Factor> = vec![];
    let mut terms = vec![];
    for (coefficient, factors) in &monomials.terms {
        let places = factors.iter().map(|factor| {
            let place = known.iter().position(|of| of == factor);
            place.unwrap_or_else(|| {
                known.push(*factor);
                known.len() - 1
            })
        });
        let places = places.collect();
        terms.push((*coefficient, places));
    }
    (known, terms)
}

/// The weights of all axes but that of instances, which repeat along those that are summed over.
fn outer_of(parts: &Parts, ids: &[PartId]) -> Vec<Extension> {
    ids.iter().fold(vec![Extension::ONE], |all, id| {
        outer(&all, &parts.get(*id).weights())
    })
}

fn elements(tables: &Tables<'_>, factor: Factor, axes: &[Axis]) -> Vec<Goldilocks> {
    let values = tables.factor(factor, axes);
    let values = values.par_iter().map(|&value| Goldilocks::from_i64(value));
    values.collect()
}

/// The sum of monomials with weights as a polynomial in the variables of instances, but for the weights of instances, which come beside it. It
/// needs the values of all instances at once: with a folder, they are in files there meanwhile.
///
/// # Errors
/// A file cannot be written.
pub fn grid(
    relations: &Relations,
    instances: &[Instance<'_>],
    parts: &Parts,
    (number, weights): (usize, &PointWeights),
    folder: Option<&Path>,
) -> io::Result<(Grid, Vec<Extension>)> {
    let monomials = &relations.monomials[number];
    let (ids, over) = own_weights(relations, parts, weights);
    let (factors, terms) = factors_of(monomials);
    let column = |instance: &Instance, factor: Factor| {
        let values = instance.with(|tables| tables.factor(factor, &monomials.axes));
        let column = Column::of_integers(&values);
        match folder {
            Some(folder) => column.into_file(folder),
            None => Ok(column),
        }
    };
    let columns = |factor: &Factor| -> io::Result<Vec<Column>> {
        let different = if differs(relations, *factor) {
            instances.len()
        } else {
            1
        };
        let own = instances[..different].iter();
        own.map(|instance| column(instance, *factor)).collect()
    };
    let columns: Vec<Vec<Column>> = factors.iter().map(columns).collect::<io::Result<_>>()?;
    let tables = columns
        .iter()
        .map(|own| own.iter().cycle().take(instances.len()).collect());
    let tables: Vec<Vec<&Column>> = tables.collect();
    let variables = instances.len().ilog2() as usize;
    let grid = Grid::of_tables(variables, &outer_of(parts, &ids), &tables, &terms);
    Ok((grid, over))
}

/// The sum of monomials with weights, where the variables of instances are at a point with these values of eq.
pub fn monomials(
    relations: &Relations,
    instances: &[Instance<'_>],
    parts: &Parts,
    (number, weights): (usize, &PointWeights),
    at: &[Extension],
) -> Joined {
    let monomials = &relations.monomials[number];
    let (ids, over) = own_weights(relations, parts, weights);
    let over: Extension = over.iter().zip(at).map(|(&weight, &at)| weight * at).sum();
    let own = outer_of(parts, &ids);
    let size = 1 << relations.size_of_one(&monomials.axes);
    let repeated: Vec<Extension> = own.iter().copied().cycle().take(size).collect();
    let mut all = vec![MultilinearTable::from(repeated)];
    let (factors, terms) = factors_of(monomials);
    for factor in factors {
        let of =
            |instance: &Instance| instance.with(|tables| elements(tables, factor, &monomials.axes));
        if at.len() == 1 || !differs(relations, factor) {
            all.push(of(&instances[0]).into());
            continue;
        }
        let mut sums = vec![Extension::ZERO; size];
        for (instance, &weight) in instances.iter().zip(at) {
            let pairs = sums.par_iter_mut().zip(of(instance));
            pairs.for_each(|(sum, value)| *sum += weight.scale(value));
        }
        all.push(sums.into());
    }
    let terms = terms.into_iter().map(|(coefficient, places)| {
        let places = [0]
            .into_iter()
            .chain(places.into_iter().map(|place| place + 1));
        (Goldilocks::from_i64(coefficient).into(), places.collect())
    });
    Joined::of_tables(all, terms.collect()).times(over)
}

/// Whether a factor may have other values in each instance.
fn differs(relations: &Relations, factor: Factor) -> bool {
    match factor {
        Factor::Virtual(number) => {
            let mut views = relations.virtuals[number].views.iter();
            views.any(|view| {
                let mut indices = view.indices.iter();
                indices
                    .any(|index| matches!(index, Index::Of(axis) if relations.are_instances(*axis)))
            })
        }
        Factor::Public(number) => {
            let axes = relations.publics[number].axes();
            axes.iter().any(|&axis| relations.are_instances(axis))
        }
        Factor::Product(_) => true,
    }
}
