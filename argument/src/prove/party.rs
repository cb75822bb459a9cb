//! The prover as one of the two sides. It works on one instance after the other, so that what it has in memory of all instances is little.

use super::grid::Grid;
use super::instance::Instance;
use super::joined::{self, Joined};
use super::looked_up;
use super::summed::{self, ProductFactors};
use super::values::{contract, numbers, packed, value, BLOCK};
use crate::field::{Extension, Goldilocks};
use crate::fractions::{self, prove::halves, LeafClaim};
use crate::layout::LookupLayout;
use crate::multilinear::{eq_table, evaluate_extension, outer};
use crate::party::{Fold, Party, Sources, Sum, ValueClaim, Weighted};
use crate::prove::progress::{Phase, Tell};
use crate::relation::{Parts, Relations};
use crate::sumcheck::prove::products;
use crate::sumcheck::JoinedPoint;
use crate::transcript::{work, Challenges, Prover, Refused};
use crate::verify::powers;
use rayon::prelude::*;
use std::io;
use std::path::Path;

/// A prover, and what it knows.
pub struct Proving<'a> {
    /// What was stated.
    pub prover: Prover,
    /// All instances. What has no instance follows, for the indices up to a power of two: its values are zero.
    instances: Vec<Instance<'a>>,
    /// How many are instances.
    count: usize,
    /// The values of each instance that claims are about whose value was stated.
    said: Vec<(Weighted, Vec<Extension>)>,
    /// Factors of products whose sums were stated, until their sumcheck.
    factors: Vec<(Sum, ProductFactors)>,
    /// Sums over the higher half of the variables of all leaves, by instance.
    halves: Vec<[Vec<Extension>; 2]>,
    /// The values of numerators and denominators at the point of all instances.
    gathered: Vec<[Extension; 2]>,
    /// Is told how far it is.
    tell: Tell<'a>,
    /// Where values are that it needs of all instances at once, and in memory if nowhere.
    folder: Option<&'a Path>,
    /// Why a file could not be written there.
    failure: Option<io::Error>,
}

/// The share of the time of adding fractions that goes into adding them; the rest goes into gathering the claims that this leaves.
const ADDING: f64 = 0.7;

impl<'a> Proving<'a> {
    /// Goes on with what was stated, with so many instances. Others follow them, whose values are zero, up to a power of two.
    pub fn new(prover: Prover, instances: Vec<Instance<'a>>, count: usize, tell: Tell<'a>) -> Self {
        Self {
            prover,
            instances,
            count,
            said: vec![],
            factors: vec![],
            halves: vec![],
            gathered: vec![],
            tell,
            folder: None,
            failure: None,
        }
    }

    /// Keeps values in files in this folder that it needs of all instances at once.
    pub fn with_files_in(self, folder: Option<&'a Path>) -> Self {
        Self { folder, ..self }
    }

    /// Why a file could not be written, after which the argument was given up.
    pub fn take_failure(&mut self) -> Option<io::Error> {
        self.failure.take()
    }

    fn say(&mut self, value: Extension) -> Extension {
        self.prover.send_secret(&[value]);
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
    type Value = Extension;

    fn nothing(&mut self, about: &Weighted) -> Extension {
        let values = vec![Extension::ZERO; self.count];
        self.said.push((about.clone(), values));
        Extension::ZERO
    }

    fn product(&mut self, a: &Extension, b: &Extension) -> Result<Extension, Refused> {
        Ok(*a * *b)
    }

    /// What is false is argued as if it were true, so that tests can see it refused.
    fn zero(&mut self, _: &'static str, _: Extension) -> Result<(), Refused> {
        Ok(())
    }

    fn published(&mut self, parts: &Parts, about: &Weighted) -> Result<Extension, Refused> {
        let value = of_instance(&self.instances[0], parts, about);
        self.prover.send_published(&[value]);
        Ok(value)
    }

    fn value(&mut self, parts: &Parts, about: &Weighted) -> Result<Extension, Refused> {
        let of = |instance: &Instance| of_instance(instance, parts, about);
        let said = match about.instances {
            None => of(&self.instances[0]),
            Some(id) => {
                let values: Vec<Extension> = self.instances[..self.count].iter().map(of).collect();
                let weights = parts.get(id).weights();
                let sum = weights.iter().zip(&values).map(|(&w, &v)| w * v).sum();
                self.said.push((about.clone(), values));
                sum
            }
        };
        Ok(self.say(said))
    }

    fn sum(
        &mut self,
        relations: &Relations,
        parts: &Parts,
        sum: &Sum,
    ) -> Result<Extension, Refused> {
        let instances = &self.instances[..];
        let value = match sum {
            Sum::Product(number, weights) => {
                let factors = ProductFactors::new(relations, instances, parts, *number, weights);
                let value = factors.total();
                self.factors.push((sum.clone(), factors));
                value
            }
            Sum::Monomials(number, weights) => {
                let (ids, own) = summed::own_weights(relations, parts, weights);
                let of = |(instance, weight): (&Instance, &Extension)| {
                    let values = instance.with(|tables| tables.monomials(*number));
                    *weight * contract(&values, parts, &ids)[0]
                };
                instances[..own.len().min(self.count)]
                    .iter()
                    .zip(&own)
                    .map(of)
                    .sum()
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
        instance: usize,
        layout: &LookupLayout,
        fold: &Fold,
    ) -> Result<LeafClaim, Refused> {
        let low = layout.variables / 2;
        let (claim, halves) = self.instances[instance].with(|own| {
            let leaves = looked_up::Fractions::new(own, layout, fold);
            let claim = fractions::prove::sum_of(&mut self.prover, layout.variables, &leaves);
            let halves = || halves::over_high(&leaves, low, &claim.point[low..]);
            let halves = (self.count > 1).then(halves);
            (claim, halves)
        });
        self.halves.extend(halves);
        let added = (instance + 1) as f64 / self.count as f64;
        let of_all = if self.count > 1 { ADDING } else { 1.0 };
        (self.tell)(Phase::Adding, of_all * added);
        Ok(claim)
    }

    fn gather(
        &mut self,
        layout: &LookupLayout,
        fold: &Fold,
        claims: &[LeafClaim],
        gamma: Extension,
    ) -> Result<(Vec<Extension>, Extension), Refused> {
        let low = layout.variables / 2;
        let combine = |[n, d]: &[Vec<Extension>; 2], power: Extension| -> Vec<Extension> {
            let pairs = n.iter().zip(d);
            pairs.map(|(&n, &d)| power * (n + gamma * d)).collect()
        };
        let scales = powers(gamma * gamma, claims.len());
        let (mut a, mut b) = (vec![], vec![]);
        for ((claim, halves), &power) in claims.iter().zip(&self.halves).zip(&scales) {
            a.extend(eq_table(&claim.point[..low]));
            b.extend(combine(halves, power));
        }
        self.halves.clear();
        let say = Prover::send_secret;
        let mut point = products(&mut self.prover, say, &mut a, &mut b, low);
        let mut halves = vec![];
        let places = a;
        let (mut a, mut b) = (vec![], vec![]);
        for (number, (claim, &place)) in claims.iter().zip(&places).enumerate() {
            let own = self.instances[number].with(|own| {
                let leaves = looked_up::Fractions::new(own, layout, fold);
                halves::over_low(&leaves, &point, layout.variables)
            });
            a.extend(
                eq_table(&claim.point[low..])
                    .iter()
                    .map(|&weight| weight * place),
            );
            b.extend(combine(&own, scales[number]));
            halves.push(own);
            let gathered = (number + 1) as f64 / claims.len() as f64;
            (self.tell)(Phase::Adding, ADDING + (1.0 - ADDING) * gathered);
        }
        let variables = layout.variables - low;
        let high = products(&mut self.prover, say, &mut a, &mut b, variables);
        let value = a.iter().zip(&b).map(|(&a, &b)| a * b).sum();
        let values = halves
            .iter()
            .map(|[n, d]| [n, d].map(|half| evaluate_extension(half, &high)));
        self.gathered = values.collect();
        point.extend(high);
        Ok((point, value))
    }

    fn gathered(&mut self, _: usize) -> Result<Vec<[Extension; 2]>, Refused> {
        let values = core::mem::take(&mut self.gathered);
        self.prover.send_secret(values.as_flattened());
        Ok(values)
    }

    fn reduce(
        &mut self,
        relations: &Relations,
        parts: &Parts,
        sums: &[(Sum, Extension)],
        gamma: Extension,
        degree: usize,
    ) -> Result<(JoinedPoint, Extension), Refused> {
        // Monomials come first, then products.
        let products = matches!(sums.first(), Some((Sum::Product(..), _)));
        let before = if products { 0.5 } else { 0.0 };
        if !products {
            (self.tell)(Phase::Claiming, 1.0);
        }
        let (_, variables) = Sum::sizes(sums, relations);
        let instances = &self.instances[..];
        let scales = powers(gamma, sums.len());
        let known = &mut self.factors;
        let factors = sums.iter().map(|(sum, _)| match sum {
            Sum::Monomials(..) => None,
            Sum::Product(number, weights) => {
                let place = known.iter().position(|(of, _)| of == sum);
                let known = place.map(|place| known.swap_remove(place).1);
                let new = || ProductFactors::new(relations, instances, parts, *number, weights);
                Some(known.unwrap_or_else(new))
            }
        });
        let factors: Vec<Option<ProductFactors>> = factors.collect();
        let mut grid = Grid::zero(variables, degree);
        // Where there is one instance, there is nothing to sum over.
        let all = sums.iter().zip(&factors).zip(&scales);
        for (((sum, value), factors), &power) in all.filter(|_| variables > 0) {
            if !sum.size(relations).1 {
                grid.add_constant(power * *value);
                continue;
            }
            let (own, over) = match (sum, factors) {
                (Sum::Monomials(number, weights), _) => {
                    let about = (*number, weights);
                    let grid = summed::grid(relations, instances, parts, about, self.folder);
                    grid.map_err(|failure| {
                        self.failure = Some(failure);
                        Refused::Equation("a sum whose values could not be kept in a file")
                    })?
                }
                (_, Some(factors)) => (
                    factors.grid(variables),
                    vec![Extension::ONE; 1 << variables],
                ),
                _ => continue,
            };
            let over: Vec<Extension> = over.iter().map(|&weight| power * weight).collect();
            grid.add_product(&own, &over);
        }
        let (mut point, _) = grid.prove(&mut self.prover);
        let own: Vec<Extension> = point.iter().rev().copied().collect();
        let at = eq_table(&own);
        let absent = JoinedPoint::new(own, variables).absent(0, false);
        let mut joined = vec![];
        for (((sum, _), factors), &power) in sums.iter().zip(factors).zip(&scales) {
            let over_instances = sum.size(relations).1;
            let next = match (sum, factors) {
                (Sum::Monomials(number, weights), _) => {
                    let at = if over_instances {
                        &at[..]
                    } else {
                        &[Extension::ONE]
                    };
                    summed::monomials(relations, instances, parts, (*number, weights), at)
                }
                (_, Some(factors)) => {
                    Joined::new(factors.at(&at).into(), vec![(Extension::ONE, vec![0, 1])])
                }
                _ => continue,
            };
            let absent = if over_instances {
                Extension::ONE
            } else {
                absent
            };
            joined.push(next.times(power * absent));
            let part = joined.len() as f64 / sums.len() as f64;
            (self.tell)(Phase::Reducing, before + 0.4 * part);
        }
        let (own, value) = joined::prove(&mut self.prover, joined, degree);
        (self.tell)(Phase::Reducing, before + 0.5);
        point.extend(own);
        point.reverse();
        Ok((JoinedPoint::new(point, variables), value))
    }

    fn reduce_claims(
        &mut self,
        parts: &Parts,
        sources: &Sources<'_>,
        claims: &[ValueClaim],
        gamma: Extension,
    ) -> Result<(JoinedPoint, Extension), Refused> {
        let variables = sources.instances;
        let scales = powers(gamma, claims.len());
        let mut grid = Grid::zero(variables, 2);
        for (claim, &power) in claims.iter().zip(&scales).filter(|_| variables > 0) {
            let said = self.said.iter().find(|(of, _)| *of == claim.about);
            let (Some((_, values)), Some(id)) = (said, claim.about.instances) else {
                return Err(Refused::Equation("a claim about no instance"));
            };
            let weights = parts.get(id).weights();
            let weights: Vec<Extension> = weights.iter().map(|&weight| power * weight).collect();
            grid.add_product(&Grid::multilinear(variables, values), &weights);
        }
        let (mut point, _) = grid.prove(&mut self.prover);
        let over: Vec<Extension> = point.iter().rev().copied().collect();
        let at = eq_table(&over);
        let mut joined = vec![];
        for &(source, bits) in sources.all {
            let mut weights = vec![Extension::ZERO; 1 << bits];
            for (ValueClaim { about, .. }, &power) in claims.iter().zip(&scales) {
                if about.source == source {
                    let over = about.instances.map(|id| parts.get(id).at(&over));
                    let power = power * over.unwrap_or(Extension::ONE);
                    add_weights(parts, about, power, &mut weights);
                }
            }
            let product = vec![(Extension::ONE, vec![0, 1])];
            let values = self.combined(source.0 as usize, bits, &at);
            joined.push(Joined::of_tables(vec![weights.into(), values], product));
        }
        let (own, value) = joined::prove(&mut self.prover, joined, 2);
        (self.tell)(Phase::Sharing, 1.0);
        point.extend(own);
        point.reverse();
        Ok((JoinedPoint::new(point, variables), value))
    }
}

/// The value of what a claim is about, in one instance.
fn of_instance(instance: &Instance<'_>, parts: &Parts, about: &Weighted) -> Extension {
    let source = about.source.0 as usize;
    instance.with(|tables| value(tables.sources[source], parts, about))
}

impl Proving<'_> {
    /// The sum over all instances of the values of a source, with weights.
    fn combined(
        &self,
        source: usize,
        bits: usize,
        weights: &[Extension],
    ) -> joined::MultilinearTable {
        if let [_] = weights {
            let own = self.instances[0].sources[source];
            let mut all = vec![Goldilocks::ZERO; 1 << bits];
            let blocks = all.par_chunks_mut(BLOCK).enumerate();
            blocks.for_each(|(block, all)| {
                let mut values = [0; BLOCK];
                own.add(block * BLOCK, 1, &mut values[..all.len()]);
                for (element, &value) in all.iter_mut().zip(&values) {
                    *element = Goldilocks::from_i64(value);
                }
            });
            self.instances[0].release();
            return all.into();
        }
        let mut sums = vec![Extension::ZERO; 1 << bits];
        for (instance, &weight) in self.instances[..self.count].iter().zip(weights) {
            let own = instance.sources[source];
            let blocks = sums.par_chunks_mut(BLOCK).enumerate();
            blocks.for_each(|(block, sums)| {
                let mut values = [0; BLOCK];
                own.add(block * BLOCK, 1, &mut values[..sums.len()]);
                for (sum, &value) in sums.iter_mut().zip(&values) {
                    *sum += weight.scale(Goldilocks::from_i64(value));
                }
            });
            instance.release();
        }
        sums.into()
    }
}

/// Adds the weights of a claim, times `power`, to those of all values of its source.
fn add_weights(parts: &Parts, about: &Weighted, power: Extension, weights: &mut [Extension]) {
    let places = about.parts.iter();
    let places = places.map(|&(shift, id)| (shift, parts.get(id).bits()));
    let places = places.collect::<Vec<_>>();
    let mut ids = about.parts.iter().map(|&(_, id)| id).peekable();
    // The lower axes, whose weights stay in a cache, and the others.
    let mut low = vec![power];
    while let Some(id) = ids.next_if(|&id| low.len() << parts.get(id).bits() <= BLOCK) {
        low = outer(&low, &parts.get(id).weights());
    }
    let high = ids.fold(vec![Extension::ONE], |high, id| {
        outer(&high, &parts.get(id).weights())
    });
    match packed(&places) {
        Some(bits) => {
            let targets = weights[about.offset..][..1 << bits].par_chunks_exact_mut(low.len());
            targets.zip(high).for_each(|(sums, high)| {
                for (sum, &low) in sums.iter_mut().zip(&low) {
                    *sum += high * low;
                }
            });
        }
        None => {
            let numbers = numbers(about.offset, &places).into_iter();
            for (number, weight) in numbers.zip(outer(&low, &high)) {
                weights[number] += weight;
            }
        }
    }
}
