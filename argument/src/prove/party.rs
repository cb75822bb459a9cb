//! The prover as one of the two sides.

use super::joined::{self, Joined, Table};
use super::looked_up;
use super::tables::{Computed, Tables};
use super::values::{contract, numbers, value, Values};
use crate::field::{Extension, Goldilocks};
use crate::fractions::{self, LeafClaim};
use crate::multilinear::outer;
use crate::protocol::{Claim, Fold, Layout, Party, Sum, Weighted, Weights};
use crate::relation::{Axis, Factor, PartId, Parts, Relations, Source};
use crate::transcript::{work, Challenges, Prover, Refused};
use rayon::prelude::*;

/// A prover, and what it knows.
pub struct Proving<'a> {
    /// What was said.
    pub prover: Prover,
    /// The values of each source, by number.
    pub sources: Vec<Values<'a>>,
    computed: Computed,
    /// Factors of products whose sums were said, until their sumcheck.
    factors: Vec<(Sum, [Vec<Extension>; 2])>,
}

impl<'a> Proving<'a> {
    /// Goes on with what was said, with the values of the sources.
    pub fn new(prover: Prover, sources: Vec<Values<'a>>) -> Self {
        Self {
            prover,
            sources,
            computed: Computed::default(),
            factors: vec![],
        }
    }

    fn tables<'r>(&'r self, relations: &'r Relations) -> Tables<'r> {
        Tables {
            relations,
            sources: &self.sources,
            computed: &self.computed,
        }
    }

    fn say(&mut self, value: Extension) -> Extension {
        self.prover.send_extension(&[value]);
        value
    }
}

impl Challenges for Proving<'_> {
    fn challenge(&mut self) -> Extension {
        self.prover.challenge()
    }

    fn positions(&mut self, count: usize, bits: u32) -> Vec<usize> {
        self.prover.positions(count, bits)
    }
}

impl Party for Proving<'_> {
    fn value(&mut self, parts: &Parts, about: &Weighted) -> Result<Extension, Refused> {
        let value = value(self.sources[about.source.0 as usize], parts, about);
        Ok(self.say(value))
    }

    fn sum(
        &mut self,
        relations: &Relations,
        parts: &Parts,
        sum: &Sum,
    ) -> Result<Extension, Refused> {
        let value = match sum {
            Sum::Product(number, weights) => {
                let factors = product_factors(&self.tables(relations), parts, *number, weights);
                let [left, right] = &factors;
                let terms = left.par_iter().zip(right).map(|(&a, &b)| a * b);
                let value = terms.reduce(|| Extension::ZERO, |a, b| a + b);
                self.factors.push((sum.clone(), factors));
                value
            }
            Sum::Monomials(number, weights) => {
                let values = self.tables(relations).monomials(*number);
                let ids: Vec<PartId> = weights.iter().map(|(_, id)| *id).collect();
                contract(&values, parts, &ids)[0]
            }
        };
        Ok(self.say(value))
    }

    fn work(&mut self, bits: u32, _: &'static str) -> Result<(), Refused> {
        work::do_work(&mut self.prover, bits);
        Ok(())
    }

    fn fractions(
        &mut self,
        relations: &Relations,
        layout: &Layout,
        fold: &Fold,
    ) -> Result<LeafClaim, Refused> {
        let leaves = looked_up::leaves(&self.tables(relations), layout, fold);
        Ok(fractions::prove::sum_of(
            &mut self.prover,
            layout.variables,
            leaves,
        ))
    }

    fn reduce(
        &mut self,
        relations: &Relations,
        parts: &Parts,
        sums: &[(Sum, Extension)],
        gamma: Extension,
        degree: usize,
    ) -> Result<(Vec<Extension>, Extension), Refused> {
        let mut joined = vec![];
        let mut power = Extension::ONE;
        for (sum, _) in sums {
            let next = match sum {
                Sum::Monomials(number, weights) => {
                    monomials(&self.tables(relations), parts, *number, weights, power)
                }
                Sum::Product(number, weights) => {
                    let known = self.factors.iter().position(|(of, _)| of == sum);
                    let factors = match known {
                        Some(place) => self.factors.swap_remove(place).1,
                        None => product_factors(&self.tables(relations), parts, *number, weights),
                    };
                    Joined::new(factors.into(), vec![(power, vec![0, 1])])
                }
            };
            joined.push(next);
            power *= gamma;
        }
        Ok(joined::prove(&mut self.prover, joined, degree))
    }

    fn reduce_claims(
        &mut self,
        parts: &Parts,
        sources: &[(Source, usize)],
        claims: &[Claim],
        gamma: Extension,
    ) -> Result<(Vec<Extension>, Extension), Refused> {
        let mut joined = vec![];
        for &(source, bits) in sources {
            let mut weights = vec![Extension::ZERO; 1 << bits];
            let mut power = Extension::ONE;
            for Claim { about, .. } in claims {
                if about.source == source {
                    add_weights(parts, about, power, &mut weights);
                }
                power *= gamma;
            }
            let values = self.sources[source.0 as usize];
            let value = |index| Goldilocks::from_i64(values.get(index));
            let values: Vec<_> = (0..1usize << bits).into_par_iter().map(value).collect();
            let product = vec![(Extension::ONE, vec![0, 1])];
            joined.push(Joined::of_tables(
                vec![weights.into(), values.into()],
                product,
            ));
        }
        Ok(joined::prove(&mut self.prover, joined, 2))
    }
}

/// Adds the weights of a claim, times `power`, to those of all values of its source.
fn add_weights(parts: &Parts, about: &Weighted, power: Extension, weights: &mut [Extension]) {
    let places = about.parts.iter();
    let places = places.map(|&(shift, id)| (shift, parts.get(id).bits()));
    let mut own = vec![power];
    for &(_, id) in &about.parts {
        own = outer(&own, &parts.get(id).weights());
    }
    let places = places.collect::<Vec<_>>();
    let packed = places.iter().try_fold(0, |end, &(shift, bits)| {
        (shift as usize == end || bits == 0).then_some(end + bits)
    });
    match packed {
        Some(_) => {
            let targets = weights[about.offset..].par_iter_mut().zip(own);
            targets.for_each(|(sum, weight)| *sum += weight);
        }
        None => {
            for (number, weight) in numbers(about.offset, &places).into_iter().zip(own) {
                weights[number] += weight;
            }
        }
    }
}

/// The two factors of a product's sum with weights, over the axes that both have. The left one has the weights of these axes.
fn product_factors(
    tables: &Tables<'_>,
    parts: &Parts,
    number: usize,
    weights: &Weights,
) -> [Vec<Extension>; 2] {
    let product = &tables.relations.products[number];
    let ids = |axes: &[Axis]| -> Vec<PartId> {
        let given = |axis: &Axis| weights.iter().find(|(of, _)| of == axis);
        axes.iter().filter_map(given).map(|(_, id)| *id).collect()
    };
    let factor = |virtual_number: usize, own: &[Axis]| {
        let axes = [own, &product.shared, &product.summed].concat();
        contract(&tables.of_virtual(virtual_number, &axes), parts, &ids(own))
    };
    let mut left = factor(product.left, &product.left_axes);
    let mut shared = vec![Extension::ONE];
    for id in ids(&product.shared) {
        shared = outer(&shared, &parts.get(id).weights());
    }
    left.par_chunks_exact_mut(shared.len()).for_each(|row| {
        for (value, &weight) in row.iter_mut().zip(&shared) {
            *value *= weight;
        }
    });
    [left, factor(product.right, &product.right_axes)]
}

/// The sum of monomials with weights, times `power`.
fn monomials(
    tables: &Tables<'_>,
    parts: &Parts,
    number: usize,
    weights: &Weights,
    power: Extension,
) -> Joined {
    let monomials = &tables.relations.monomials[number];
    let mut own = vec![power];
    for (_, id) in weights.iter() {
        own = outer(&own, &parts.get(*id).weights());
    }
    let size = 1 << tables.relations.size(&monomials.axes);
    let weights: Vec<Extension> = own.iter().copied().cycle().take(size).collect();
    let mut all = vec![Table::from(weights)];
    let mut known: Vec<Factor> = vec![];
    let mut terms = vec![];
    for (coefficient, factors) in &monomials.terms {
        let mut places = vec![0];
        for factor in factors {
            let place = known.iter().position(|of| of == factor);
            let place = place.unwrap_or_else(|| {
                let values = tables.factor(*factor, &monomials.axes);
                let values = values.par_iter().map(|&v| Goldilocks::from_i64(v));
                all.push(values.collect::<Vec<Goldilocks>>().into());
                known.push(*factor);
                known.len() - 1
            });
            places.push(place + 1);
        }
        terms.push((Goldilocks::from_i64(*coefficient).into(), places));
    }
    Joined::of_tables(all, terms)
}
