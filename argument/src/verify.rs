//! The verifier's side of an argument: it reads what the prover says, and draws the challenges.

use crate::field::Extension;
use crate::fractions::{self, LeafClaim};
use crate::protocol::{Claim, Fold, Layout, Party, Sum, Weighted};
use crate::relation::{Parts, Relations, Source};
use crate::sumcheck;
use crate::transcript::{work, Refused, Verifier};
use alloc::vec::Vec;

impl Sum {
    /// Binary logarithm of the number of terms.
    pub fn variables(&self, relations: &Relations) -> usize {
        match self {
            Self::Monomials(number, _) => relations.size(&relations.monomials[*number].axes),
            Self::Product(number, _) => {
                let product = &relations.products[*number];
                relations.size(&product.shared) + relations.size(&product.summed)
            }
        }
    }
}

/// `values` times 1, `gamma`, `gamma²`, …
pub fn powers(values: impl Iterator<Item = Extension>, gamma: Extension) -> Vec<Extension> {
    let mut power = Extension::ONE;
    let scaled = values.map(|value| {
        let scaled = power * value;
        power *= gamma;
        scaled
    });
    scaled.collect()
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

    fn fractions(
        &mut self,
        _: &Relations,
        layout: &Layout,
        _: &Fold,
    ) -> Result<LeafClaim, Refused> {
        fractions::verify(self, layout.variables)
    }

    fn reduce(
        &mut self,
        relations: &Relations,
        _: &Parts,
        sums: &[(Sum, Extension)],
        gamma: Extension,
        degree: usize,
    ) -> Result<(Vec<Extension>, Extension), Refused> {
        let claims = powers(sums.iter().map(|(_, value)| *value), gamma);
        let sizes = sums.iter().map(|(sum, _)| sum.variables(relations));
        let sums: Vec<(usize, Extension)> = sizes.zip(claims).collect();
        sumcheck::verify_joined(self, &sums, degree)
    }

    fn reduce_claims(
        &mut self,
        _: &Parts,
        sources: &[(Source, usize)],
        claims: &[Claim],
        gamma: Extension,
    ) -> Result<(Vec<Extension>, Extension), Refused> {
        let scaled = powers(claims.iter().map(|claim| claim.value), gamma);
        let of = |source: Source| -> Extension {
            let own = claims.iter().zip(&scaled);
            own.filter(|(claim, _)| claim.about.source == source)
                .map(|(_, &value)| value)
                .sum()
        };
        let sums = sources.iter().map(|&(source, bits)| (bits, of(source)));
        let sums: Vec<(usize, Extension)> = sums.collect();
        sumcheck::verify_joined(self, &sums, 2)
    }
}
