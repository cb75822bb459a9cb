//! What differs between the two sides of an argument, and what both speak of: claims, and sums that a sumcheck reduces.

use crate::field::Extension;
use crate::form::Secret;
use crate::fractions::LeafClaim;
use crate::layout::LookupLayout;
use crate::relation::{ColumnSource, PartId, Parts, Relations, COLUMNS};
use crate::sumcheck::JoinedPoint;
use crate::transcript::{Challenges, Refused};
use crate::weights::PointWeights;
use alloc::vec::Vec;

/// What a claim is about: `Σ_b w(b)·T(b)`, where T has the values of a source whose numbers are `offset` plus shifted indices.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Weighted {
    /// Where the values are.
    pub source: ColumnSource,
    /// Number of the first value.
    pub offset: usize,
    /// For each axis where its index stands in the number of a value, and the weights.
    pub parts: Vec<(u8, PartId)>,
    /// The weights of instances, where each has values of its own.
    pub instances: Option<PartId>,
}

/// A claim about values that were committed to, or about others.
#[derive(Clone, Debug)]
pub struct ValueClaim<V = Extension> {
    /// What it is about.
    pub about: Weighted,
    /// What the sum is.
    pub value: V,
}

/// The sum of `values` times 1, `gamma`, `gamma²`, …
pub fn combine<'a, V: Secret + 'a>(values: impl Iterator<Item = &'a V>, gamma: Extension) -> V {
    let mut sum = V::default();
    let mut power = Extension::ONE;
    for value in values {
        sum.add(power, value);
        power *= gamma;
    }
    sum
}

/// What a sum is about that a sumcheck reduces.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Sum {
    /// Monomials with this number, with weights.
    Monomials(usize, PointWeights),
    /// The product with this number, with weights.
    Product(usize, PointWeights),
}

/// One of the two sides.
pub trait Party: Challenges {
    /// What it knows of a value that the prover does not show.
    type Value: Secret;
    /// The value of what a claim is about: the prover computes it, and states it with a pad.
    fn value(&mut self, parts: &Parts, about: &Weighted) -> Result<Self::Value, Refused>;
    /// The value of what a claim is about that everybody can compute: the prover states it as it is.
    fn published(&mut self, parts: &Parts, about: &Weighted) -> Result<Extension, Refused>;
    /// States that what a claim is about has the value zero. Nothing is stated.
    fn nothing(&mut self, about: &Weighted) -> Self::Value;
    /// The product of two values, one of which is known or no product of two secret ones.
    fn product(&mut self, a: &Self::Value, b: &Self::Value) -> Result<Self::Value, Refused>;
    /// States that a value is zero.
    fn zero(&mut self, what: &'static str, value: Self::Value) -> Result<(), Refused>;
    /// The value of a sum: likewise.
    fn sum(
        &mut self,
        relations: &Relations,
        parts: &Parts,
        sum: &Sum,
    ) -> Result<Self::Value, Refused>;
    /// A proof of work: the prover does it, and the verifier checks it.
    fn work(&mut self, bits: u32, what: &'static str) -> Result<(), Refused>;
    /// The sum of all fractions of an instance is zero. `fold` folds the columns of an entry into one value, after it was taken from `shift`.
    fn fractions(
        &mut self,
        instance: usize,
        layout: &LookupLayout,
        fold: &Fold,
    ) -> Result<LeafClaim<Self::Value>, Refused>;
    /// The sumcheck of `Σ coefficient · claim`, where the coefficients are powers of `gamma`, over the numerators and denominators of all
    /// instances. Returns its point, and the value there.
    fn gather(
        &mut self,
        layout: &LookupLayout,
        fold: &Fold,
        claims: &[LeafClaim<Self::Value>],
        gamma: Extension,
    ) -> Result<(Vec<Extension>, Self::Value), Refused>;
    /// The values at that point of the numerators and denominators of so many instances.
    fn gathered(&mut self, count: usize) -> Result<Vec<[Self::Value; 2]>, Refused>;
    /// The sumcheck of `Σ coefficient · sum`, where the coefficients are powers of `gamma`. Returns its point, and the value there.
    fn reduce(
        &mut self,
        relations: &Relations,
        parts: &Parts,
        sums: &[(Sum, Self::Value)],
        gamma: Extension,
        degree: usize,
    ) -> Result<(JoinedPoint, Self::Value), Refused>;
    /// The sumcheck of `Σ coefficient · claim` over the values of all `sources`, which have so many variables for each instance and which all
    /// claims are about. Returns its point, and the value there.
    fn reduce_claims(
        &mut self,
        parts: &Parts,
        sources: &Sources<'_>,
        claims: &[ValueClaim<Self::Value>],
        gamma: Extension,
    ) -> Result<(JoinedPoint, Self::Value), Refused>;
}

/// Sources whose values are committed to for each instance.
#[derive(Clone, Copy, Debug)]
pub struct Sources<'a> {
    /// Each with the binary logarithm of the number of its values.
    pub all: &'a [(ColumnSource, usize)],
    /// Variables of instances.
    pub instances: usize,
}

impl Sources<'_> {
    /// Variables of the largest one.
    pub fn variables(&self) -> usize {
        let bits = self.all.iter().map(|(_, bits)| *bits);
        bits.max().unwrap_or_default()
    }
}

/// How an entry becomes a denominator: `shift − Σ powers·columns`.
#[derive(Clone, Copy, Debug)]
pub struct Fold {
    /// α.
    pub shift: Extension,
    /// 1, β, β², β³
    pub powers: [Extension; COLUMNS],
}
