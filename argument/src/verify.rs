//! The verifier's side of an argument: it reads what the prover says, and draws the challenges.

use crate::field::Extension;
use crate::fractions::{self, LeafClaim};
use crate::gather::combined;
use crate::layout::Layout;
use crate::party::{Claim, Fold, Party, Sources, Sum, Weighted};
use crate::relation::{Parts, Relations};
use crate::sumcheck::{self, JoinedPoint};
use crate::transcript::{work, Refused, Verifier};
use alloc::vec::Vec;

impl Sum {
    /// Variables within an instance of what is summed, and whether it is summed over all instances.
    pub fn size(&self, relations: &Relations) -> (usize, bool) {
        let lists = match self {
            Self::Monomials(number, _) => [&relations.monomials[*number].axes[..], &[]],
            Self::Product(number, _) => {
                let product = &relations.products[*number];
                [&product.shared[..], &product.summed]
            }
        };
        let variables = lists.iter().map(|axes| relations.size_of_one(axes)).sum();
        let mut axes = lists.into_iter().flatten();
        (variables, axes.any(|&axis| relations.are_instances(axis)))
    }

    /// The most variables of any of these sums within an instance, and those of instances if any sum is over them.
    pub fn sizes(sums: &[(Self, Extension)], relations: &Relations) -> (usize, usize) {
        let (mut variables, mut instances) = (0, 0);
        for (sum, _) in sums {
            let (own, over_instances) = sum.size(relations);
            variables = variables.max(own);
            if over_instances {
                instances = relations.bits_of_instances();
            }
        }
        (variables, instances)
    }
}

/// 1, `base`, `base²`, …: so many.
#[cfg(feature = "prove")]
pub fn powers(base: Extension, count: usize) -> Vec<Extension> {
    let next = |power: &Extension| Some(*power * base);
    core::iter::successors(Some(Extension::ONE), next)
        .take(count)
        .collect()
}

/// The sum of `values` times 1, `gamma`, `gamma²`, …
fn combine(values: impl Iterator<Item = Extension>, gamma: Extension) -> Extension {
    let mut power = Extension::ONE;
    let scaled = values.map(|value| {
        let scaled = power * value;
        power *= gamma;
        scaled
    });
    scaled.sum()
}

impl Party for Verifier<'_> {
    fn value(&mut self, _: &Parts, _: &Weighted) -> Result<Extension, Refused> {
        Ok(self.receive_extension(1)?[0])
    }

    fn sum(&mut self, _: &Relations, _: &Parts, _: &Sum) -> Result<Extension, Refused> {
        Ok(self.receive_extension(1)?[0])
    }

    fn work(&mut self, bits: u32, what: &'static str) -> Result<(), Refused> {
        work::check_work(self, bits, what)
    }

    fn fractions(&mut self, _: usize, layout: &Layout, _: &Fold) -> Result<LeafClaim, Refused> {
        fractions::verify(self, layout.variables)
    }

    fn gather(
        &mut self,
        layout: &Layout,
        _: &Fold,
        claims: &[LeafClaim],
        gamma: Extension,
    ) -> Result<(Vec<Extension>, Extension), Refused> {
        sumcheck::verify(self, layout.variables, 2, combined(claims, gamma))
    }

    fn gathered(&mut self, count: usize) -> Result<Vec<[Extension; 2]>, Refused> {
        let values = self.receive_extension(2 * count)?;
        Ok(values.as_chunks().0.to_vec())
    }

    fn reduce(
        &mut self,
        relations: &Relations,
        _: &Parts,
        sums: &[(Sum, Extension)],
        gamma: Extension,
        degree: usize,
    ) -> Result<(JoinedPoint, Extension), Refused> {
        let claim = combine(sums.iter().map(|(_, value)| *value), gamma);
        let (variables, instances) = Sum::sizes(sums, relations);
        sumcheck::verify_joined(self, variables, instances, degree, claim)
    }

    fn reduce_claims(
        &mut self,
        _: &Parts,
        sources: &Sources<'_>,
        claims: &[Claim],
        gamma: Extension,
    ) -> Result<(JoinedPoint, Extension), Refused> {
        let claim = combine(claims.iter().map(|claim| claim.value), gamma);
        sumcheck::verify_joined(self, sources.variables(), sources.instances, 2, claim)
    }
}
