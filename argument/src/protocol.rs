//! The argument that a segment obeys its [`Relations`]: what prover and verifier do in the same order.
//!
//! 1. After a proof of work, all look-ups of an instance are one sum of fractions ([`crate::fractions`]; logarithmic derivatives, Haböck 2022,
//!    eprint 2022/1530). It leaves a claim at a random point of its leaves. [`crate::gather`] takes the claims of all instances to one point, where
//!    they are added with random weights. Claims about the columns of each look-up follow. Equalities are claimed at the same point.
//! 2. Claims about monomials become claims about their factors, by one sumcheck for all.
//! 3. Claims about products become claims about their factors, by one sumcheck for all.
//! 4. What is left are claims about tensors. [`crate::share`] makes one claim about a source of all that are about it.
//!
//! A value that the prover claims is stated when it is first needed. It is secret, unless everybody can compute it. [`crate::party::Party`] is what differs between the two sides.

use crate::field::{Extension, Goldilocks};
use crate::form::Secret;
use crate::gather::{gather, Gathered};
use crate::layout::LookupLayout;
use crate::operation;
use crate::party::{Fold, Party, Sum, ValueClaim, Weighted};
use crate::relation::{
    Atom, Axis, Count, Factor, Index, LinearSum, Part, Parts, Relations, MAX_FACTORS,
};
use crate::transcript::Refused;
use crate::weights::{Known, Point, PointWeights};
use alloc::vec;
use alloc::vec::Vec;

/// Bits of the proof of work before entries are folded. An entry that is in no table passes with as many times 2^-128 as there are
/// fractions of all samples, up to 2^36: work takes that below 2^-105.
const WORK: u32 = 16;

/// The argument, in progress.
struct Argument<'a, P: Party> {
    party: &'a mut P,
    relations: &'a Relations,
    parts: &'a mut Parts,
    left: LeftClaims<P::Value>,
    monomials: Vec<(Sum, P::Value)>,
    products: Vec<(Sum, P::Value)>,
    /// Values of virtual tensors that were claimed.
    virtuals: Known<P::Value>,
    /// Values of public tensors that were computed.
    publics: Known<Extension>,
}

/// Claims that are left to show.
pub struct LeftClaims<V> {
    /// About secret values.
    pub secret: Vec<ValueClaim<V>>,
    /// About values that everybody can have.
    pub published: Vec<ValueClaim>,
}

/// Argues that the relations hold if the claims do that are returned. `parts` holds their weights.
pub fn argue<P: Party>(
    party: &mut P,
    relations: &Relations,
    parts: &mut Parts,
) -> Result<LeftClaims<P::Value>, Refused> {
    let mut argument = Argument {
        party,
        relations,
        parts,
        left: LeftClaims {
            secret: vec![],
            published: vec![],
        },
        monomials: vec![],
        products: vec![],
        virtuals: Known::new(relations.virtuals.len()),
        publics: Known::new(relations.publics.len()),
    };
    argument.lookups()?;
    let reducing = operation("monomials");
    argument.monomials()?;
    reducing.end();
    let reducing = operation("products");
    argument.products()?;
    reducing.end();
    Ok(argument.left)
}

impl<P: Party> Argument<'_, P> {
    fn lookups(&mut self) -> Result<(), Refused> {
        let relations = self.relations;
        self.party.work(WORK, "look-ups")?;
        let beta = self.party.challenge();
        let fold = Fold {
            shift: self.party.challenge(),
            powers: [Extension::ONE, beta, beta * beta, beta * beta * beta],
        };
        let layout = LookupLayout::new(relations);
        let adding = operation("sum of fractions");
        let leaves = (0..relations.count_of_instances())
            .map(|instance| self.party.fractions(instance, &layout, &fold));
        let leaves = leaves.collect::<Result<Vec<_>, _>>()?;
        let Gathered { leaf, mut weights } = gather(self.party, &layout, &fold, leaves)?;
        adding.end();
        let _claiming = operation("claims of look-ups");
        // Indices without an instance count nowhere.
        weights.resize(1 << relations.bits_of_instances(), Extension::ZERO);
        let instances = self.parts.add(Part::Vector(weights));
        let mut point = Point::new(&leaf.point, instances);
        let all = self.parts.total(instances);
        let mut numerator = P::Value::default();
        let mut denominator = P::Value::from(all);
        let places = layout.places(&leaf.point);
        for (lookup, place) in relations.lookups.iter().zip(places) {
            let weights = point.weights(relations, self.parts, &lookup.axes);
            match lookup.count {
                Count::Each => numerator.add_known(place * all),
                Count::Masked(public) => {
                    numerator.add_known(place * self.public(public, &weights));
                }
                Count::Offered(number) => {
                    self.add_virtual(&mut numerator, -place, number, &weights)?;
                }
            }
            // Leaves of no look-up are 0/1.
            denominator.add_known(place * (fold.shift * all - all));
            for (&power, column) in fold.powers.iter().zip(&lookup.entry) {
                self.add_linear(&mut denominator, -place * power, column, &weights)?;
            }
        }
        const LEAVES: &str = "the leaves of a sum of look-ups";
        self.party.zero(LEAVES, numerator.minus(&leaf.numerator))?;
        let rest = denominator.minus(&leaf.denominator);
        self.party.zero(LEAVES, rest)?;
        for equality in &relations.equalities {
            let weights = point.weights(relations, self.parts, &equality.axes);
            let mut value = P::Value::default();
            self.add_linear(&mut value, Extension::ONE, &equality.linear, &weights)?;
            self.party.zero(equality.name, value)?;
        }
        Ok(())
    }

    /// Adds `factor · Σ_b weights(b) · linear(b)` to `sum`.
    fn add_linear(
        &mut self,
        sum: &mut P::Value,
        factor: Extension,
        linear: &LinearSum,
        weights: &PointWeights,
    ) -> Result<(), Refused> {
        for term in linear {
            let scaled;
            let weights = match term.coefficients {
                None => weights,
                Some(number) => {
                    scaled = self.scaled(weights, number);
                    &scaled
                }
            };
            let factor = factor.scale(Goldilocks::from_i64(term.factor));
            match term.atom {
                Atom::One => {
                    let total = self.total(weights, |_| true);
                    sum.add_known(factor * total);
                }
                Atom::Virtual(number) => self.add_virtual(sum, factor, number, weights)?,
                Atom::Product(number) => sum.add(factor, &self.product_at(number, weights)?),
                Atom::Monomials(number) => sum.add(factor, &self.monomials_at(number, weights)?),
                Atom::Public(number) => sum.add_known(factor * self.public(number, weights)),
                Atom::Summed(number) => {
                    let summed = &self.relations.sums[number];
                    let mut all = *weights;
                    for &axis in &summed.axes {
                        let bits = self.relations.bits(axis) as u32;
                        all.push(axis, self.parts.ones(bits));
                    }
                    self.add_virtual(sum, factor, summed.of, &all)?;
                }
            }
        }
        Ok(())
    }

    fn scaled(&mut self, weights: &PointWeights, number: usize) -> PointWeights {
        let (axis, factors) = &self.relations.coefficients[number];
        let mut scaled = *weights;
        for (_, part) in scaled.iter_mut().filter(|(of, _)| of == axis) {
            *part = self.parts.scaled(*part, number, factors);
        }
        scaled
    }

    /// The product of the sums of the weights on some axes.
    fn total(&self, weights: &PointWeights, which: impl Fn(Axis) -> bool) -> Extension {
        let totals = weights.iter().filter(|(axis, _)| which(*axis));
        totals.fold(Extension::ONE, |product, &(_, part)| {
            match self.parts.get(part) {
                Part::Point(_) => product,
                _ => product * self.parts.total(part),
            }
        })
    }

    /// A public tensor with weights, which repeats along the other axes.
    fn public(&mut self, number: usize, weights: &PointWeights) -> Extension {
        let public = &self.relations.publics[number];
        let axes = public.axes();
        let own = weights.of(axes);
        let value = match self.publics.get(number, &own) {
            Some(value) => *value,
            None => {
                let mut tables = own;
                if !public.likes_points() {
                    for (_, id) in tables.iter_mut() {
                        *id = self.parts.table(*id);
                    }
                }
                let parts = tables.iter().map(|&(_, id)| self.parts.get(id));
                let parts: Vec<&Part> = parts.collect();
                let evaluating = operation("public tensors");
                let value = public.at(&parts);
                evaluating.end();
                self.publics.insert(number, own, value);
                value
            }
        };
        value * self.total(weights, |axis| !axes.contains(&axis))
    }

    /// Adds `factor` times a virtual tensor with weights.
    fn add_virtual(
        &mut self,
        sum: &mut P::Value,
        factor: Extension,
        number: usize,
        weights: &PointWeights,
    ) -> Result<(), Refused> {
        if self.virtuals.get(number, weights).is_none() {
            let value = self.claimed(number, weights)?;
            self.virtuals.insert(number, *weights, value);
        }
        if let Some(value) = self.virtuals.get(number, weights) {
            sum.add(factor, value);
        }
        Ok(())
    }

    fn virtual_at(&mut self, number: usize, weights: &PointWeights) -> Result<P::Value, Refused> {
        let mut value = P::Value::default();
        self.add_virtual(&mut value, Extension::ONE, number, weights)?;
        Ok(value)
    }

    /// A virtual tensor with weights, which is claimed.
    fn claimed(&mut self, number: usize, weights: &PointWeights) -> Result<P::Value, Refused> {
        let relations = self.relations;
        let mut sum = P::Value::default();
        for view in &relations.virtuals[number].views {
            let tensor = &relations.tensors[view.tensor];
            let mut parts = Vec::with_capacity(view.indices.len());
            let mut read = Vec::with_capacity(view.indices.len());
            let mut offset = tensor.offset;
            let mut instances = None;
            for (index, place) in view.indices.iter().zip(&tensor.places) {
                let id = match *index {
                    Index::Of(axis) => {
                        read.push(axis);
                        if relations.are_instances(axis) {
                            instances = Some(weights.part(axis));
                            continue;
                        }
                        weights.part(axis)
                    }
                    Index::Mapped(axis, map) => {
                        read.push(axis);
                        let id = weights.part(axis);
                        let map = (map, &relations.maps[map][..]);
                        self.parts.mapped(id, map, place.bits as usize)
                    }
                    Index::Fixed(index) => {
                        offset += index << place.shift;
                        continue;
                    }
                };
                parts.push((place.shift, id));
            }
            let mut factor = self.total(weights, |axis| {
                !read.contains(&axis) && !view.only.iter().any(|(only, _)| *only == axis)
            });
            for &(axis, index) in &view.only {
                factor *= self.parts.get(weights.part(axis)).weight(index);
            }
            let about = Weighted {
                source: tensor.source,
                offset,
                parts,
                instances,
            };
            let factor = factor.scale(Goldilocks::from_i64(view.factor));
            if relations.published.contains(&tensor.source) {
                let value = self.party.published(self.parts, &about)?;
                sum.add_known(factor * value);
                self.left.published.push(ValueClaim { about, value });
            } else {
                let value = self.party.value(self.parts, &about)?;
                sum.add(factor, &value);
                self.left.secret.push(ValueClaim { about, value });
            }
        }
        Ok(sum)
    }

    fn product_at(&mut self, number: usize, weights: &PointWeights) -> Result<P::Value, Refused> {
        let product = &self.relations.products[number];
        let axes = [&product.left_axes, &product.right_axes, &product.shared];
        let own = weights.of(axes.into_iter().flatten());
        let repeated = self.total(weights, |axis| own.iter().all(|(of, _)| *of != axis));
        let sum = Sum::Product(number, own);
        let known = self.products.iter().find(|(of, _)| *of == sum);
        let value = match known {
            Some((_, value)) => value.times(repeated),
            None => {
                let value = self.party.sum(self.relations, self.parts, &sum)?;
                let product = value.times(repeated);
                self.products.push((sum, value));
                product
            }
        };
        Ok(value)
    }

    fn monomials_at(&mut self, number: usize, weights: &PointWeights) -> Result<P::Value, Refused> {
        let monomials = &self.relations.monomials[number];
        let kept = &monomials.axes[..monomials.axes.len() - monomials.summed];
        let own = weights.of(kept);
        let repeated = self.total(weights, |axis| !kept.contains(&axis));
        let sum = Sum::Monomials(number, own);
        let known = self.monomials.iter().find(|(of, _)| *of == sum);
        let value = match known {
            Some((_, value)) => value.times(repeated),
            None => {
                let value = self.party.sum(self.relations, self.parts, &sum)?;
                let monomials = value.times(repeated);
                self.monomials.push((sum, value));
                monomials
            }
        };
        Ok(value)
    }

    fn monomials(&mut self) -> Result<(), Refused> {
        let relations = self.relations;
        let sums = core::mem::take(&mut self.monomials);
        let gamma = self.party.challenge();
        let (joined, value) =
            self.party
                .reduce(relations, self.parts, &sums, gamma, MAX_FACTORS + 1)?;
        let instances = self.parts.add(Part::Point(joined.instances.clone()));
        let mut point = Point::new(&joined.own, instances);
        let mut expected = P::Value::default();
        let mut power = Extension::ONE;
        for (sum, _) in &sums {
            let Sum::Monomials(number, weights) = sum else {
                continue;
            };
            let monomials = &relations.monomials[*number];
            let at = point.weights(relations, self.parts, &monomials.axes);
            let (variables, over_instances) = sum.size(relations);
            let mut scale = power * joined.absent(variables, over_instances);
            for (axis, id) in weights.iter() {
                if let Part::Point(coordinates) = self.parts.get(at.part(*axis)) {
                    scale *= self.parts.get(*id).at(coordinates);
                }
            }
            for (coefficient, factors) in &monomials.terms {
                let mut product = P::Value::from(scale.scale(Goldilocks::from_i64(*coefficient)));
                for factor in factors {
                    let factor = match *factor {
                        Factor::Virtual(number) => self.virtual_at(number, &at)?,
                        Factor::Product(number) => self.product_at(number, &at)?,
                        Factor::Public(number) => self.public(number, &at).into(),
                    };
                    product = self.party.product(&product, &factor)?;
                }
                expected.add(Extension::ONE, &product);
            }
            power *= gamma;
        }
        self.party
            .zero("the sumcheck of the monomials", expected.minus(&value))
    }

    fn products(&mut self) -> Result<(), Refused> {
        let relations = self.relations;
        let sums = core::mem::take(&mut self.products);
        let gamma = self.party.challenge();
        let (joined, value) = self.party.reduce(relations, self.parts, &sums, gamma, 2)?;
        let instances = self.parts.add(Part::Point(joined.instances.clone()));
        let mut point = Point::new(&joined.own, instances);
        let mut expected = P::Value::default();
        let mut power = Extension::ONE;
        for (sum, _) in &sums {
            let Sum::Product(number, weights) = sum else {
                continue;
            };
            let product = &relations.products[*number];
            let domain: Vec<Axis> = [&product.shared[..], &product.summed].concat();
            let at = point.weights(relations, self.parts, &domain);
            // The right factor has the point on shared axes, and the left one the claim's weights too.
            let mut right = at;
            let mut left = at;
            for (axis, id) in left.iter_mut().take(product.shared.len()) {
                *id = self.parts.times(*id, weights.part(*axis));
            }
            for (side, axes) in [
                (&mut left, &product.left_axes),
                (&mut right, &product.right_axes),
            ] {
                for &axis in axes {
                    side.push(axis, weights.part(axis));
                }
            }
            let left = self.virtual_at(product.left, &left)?;
            let right = self.virtual_at(product.right, &right)?;
            let (variables, over_instances) = sum.size(relations);
            let product = self.party.product(&left, &right)?;
            expected.add(power * joined.absent(variables, over_instances), &product);
            power *= gamma;
        }
        self.party
            .zero("the sumcheck of the products", expected.minus(&value))
    }
}
