//! The verifier's side of an argument: it reads what the prover states, and draws the challenges.

use crate::field::Extension;
use crate::form::{Equations, Form};
use crate::fractions::{self, LeafClaim};
use crate::gather::combined;
use crate::layout::LookupLayout;
use crate::party::{combine, Fold, Party, Sources, Sum, ValueClaim, Weighted};
use crate::relation::{Parts, Relations};
use crate::sumcheck::{self, JoinedPoint};
use crate::transcript::{require, work, Challenges, Refused, Verifier};
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
    pub fn sizes<V>(sums: &[(Self, V)], relations: &Relations) -> (usize, usize) {
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

/// A verifier, and what it knows of secret values.
pub struct Verifying<'a, 'v> {
    /// What was stated.
    pub verifier: &'a mut Verifier<'v>,
    /// What has to hold of secret values.
    pub equations: Equations,
}

impl<'a, 'v> Verifying<'a, 'v> {
    /// Goes on with what was stated.
    pub fn new(verifier: &'a mut Verifier<'v>) -> Self {
        Self {
            verifier,
            equations: Equations::default(),
        }
    }

    fn value(&mut self) -> Result<Form, Refused> {
        Ok(Form::of_said(self.verifier.receive_secret(1)?.start))
    }
}

impl Challenges for Verifying<'_, '_> {
    #[inline(always)]
    fn challenge(&mut self) -> Extension {
        self.verifier.challenge()
    }

    fn positions(&mut self, count: usize, bits: u32) -> Vec<usize> {
        self.verifier.positions(count, bits)
    }
}

impl Party for Verifying<'_, '_> {
    type Value = Form;

    fn value(&mut self, _: &Parts, _: &Weighted) -> Result<Form, Refused> {
        self.value()
    }

    /// Whoever computes it again has the weights of all axes but that of instances.
    fn published(&mut self, _: &Parts, about: &Weighted) -> Result<Extension, Refused> {
        let all = about.instances.is_none();
        require(all, Refused::Bounds("the instances of a published claim"))?;
        Ok(self.verifier.receive_extension(1)?[0])
    }

    fn nothing(&mut self, _: &Weighted) -> Form {
        Form::default()
    }

    fn product(&mut self, a: &Form, b: &Form) -> Result<Form, Refused> {
        self.equations.product(a, b)
    }

    fn zero(&mut self, what: &'static str, value: Form) -> Result<(), Refused> {
        self.equations.zero(what, value)
    }

    fn sum(&mut self, _: &Relations, _: &Parts, _: &Sum) -> Result<Form, Refused> {
        self.value()
    }

    fn work(&mut self, bits: u32, what: &'static str) -> Result<(), Refused> {
        work::check_work(self.verifier, bits, what)
    }

    fn fractions(
        &mut self,
        _: usize,
        layout: &LookupLayout,
        _: &Fold,
    ) -> Result<LeafClaim<Form>, Refused> {
        fractions::verify(self.verifier, layout.variables, &mut self.equations)
    }

    fn gather(
        &mut self,
        layout: &LookupLayout,
        _: &Fold,
        claims: &[LeafClaim<Form>],
        gamma: Extension,
    ) -> Result<(Vec<Extension>, Form), Refused> {
        let claim = combined(claims, gamma);
        sumcheck::verify_secret(self.verifier, layout.variables, 2, claim)
    }

    fn gathered(&mut self, count: usize) -> Result<Vec<[Form; 2]>, Refused> {
        let first = self.verifier.receive_secret(2 * count)?.start;
        let of = |place| [0, 1].map(|part| Form::of_said(first + 2 * place + part));
        Ok((0..count).map(of).collect())
    }

    fn reduce(
        &mut self,
        relations: &Relations,
        _: &Parts,
        sums: &[(Sum, Form)],
        gamma: Extension,
        degree: usize,
    ) -> Result<(JoinedPoint, Form), Refused> {
        let claim = combine(sums.iter().map(|(_, value)| value), gamma);
        let (variables, instances) = Sum::sizes(sums, relations);
        sumcheck::verify_joined(self.verifier, variables, instances, degree, claim)
    }

    fn reduce_claims(
        &mut self,
        _: &Parts,
        sources: &Sources<'_>,
        claims: &[ValueClaim<Form>],
        gamma: Extension,
    ) -> Result<(JoinedPoint, Form), Refused> {
        let claim = combine(claims.iter().map(|claim| &claim.value), gamma);
        sumcheck::verify_joined(
            self.verifier,
            sources.variables(),
            sources.instances,
            2,
            claim,
        )
    }
}
