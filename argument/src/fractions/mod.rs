//! A sum of fractions that is zero, shown by GKR on the tree that adds them in pairs (Papini and Haböck 2023, eprint 2023/1284).
//!
//! Layer ℓ of the tree has 2^ℓ fractions p/q. Fraction x of it is the sum of fractions 2x and 2x + 1 of layer ℓ + 1:
//! `p = p0·q1 + p1·q0` and `q = q0·q1`. A claim about p and q at a point of one layer becomes a claim about both at a point of the next one,
//! by a sumcheck of `Σ_x eq(r, x) · (p0·q1 + p1·q0 + λ·q0·q1)(x)`. The factor eq is left out of what the prover states (Gruen 2024, eprint
//! 2024/108): a round polynomial g has degree 2, and `(1 − r_i)·g(0) + r_i·g(1)` is the claim.

#[cfg(feature = "prove")]
mod leaves;
#[cfg(feature = "prove")]
pub mod prove;

use crate::field::Extension;
use crate::form::Secret;
use crate::form::{Equations, Form};
use crate::transcript::{Challenges, Refused, Verifier};
use alloc::vec::Vec;

/// A point of the leaves, and the values of their numerators and denominators there. It is left to show.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LeafClaim<V = Extension> {
    /// The point.
    pub point: Vec<Extension>,
    /// Of the numerators.
    pub numerator: V,
    /// Of the denominators.
    pub denominator: V,
}

/// The values of p at 2x and 2x + 1, and those of q.
#[derive(Clone)]
struct Children<V> {
    p: [V; 2],
    q: [V; 2],
}

impl Children<Form> {
    fn receive(verifier: &mut Verifier<'_>) -> Result<Self, Refused> {
        let first = verifier.receive_secret(4)?.start;
        let of = |place| Form::of_said(first + place);
        Ok(Self {
            p: [of(0), of(1)],
            q: [of(2), of(3)],
        })
    }

    /// `value` is `p0·q1 + p1·q0 + λ·q0·q1`, as two products.
    fn sum_is(
        &self,
        lambda: Extension,
        mut value: Form,
        equations: &mut Equations,
    ) -> Result<(), Refused> {
        let Self { p, q } = self;
        let mut mixed = p[0].clone();
        mixed.add(lambda, &q[0]);
        for product in [
            equations.product(&mixed, &q[1])?,
            equations.product(&p[1], &q[0])?,
        ] {
            value.add(-Extension::ONE, &product);
        }
        equations.zero("a layer of a sum of look-ups", value)
    }
}

impl<V: Secret> Children<V> {
    /// Numerator and denominator between both, at `step`.
    fn between(&self, step: Extension) -> [V; 2] {
        [&self.p, &self.q].map(|[zero, one]| {
            let mut between = zero.times(Extension::ONE - step);
            between.add(step, one);
            between
        })
    }
}

/// Checks that 2^`variables` fractions add up to zero, if the claim about the leaves holds that is returned, and the equations do.
///
/// The root's denominator is not zero: the prover states its inverse, too.
pub fn verify(
    verifier: &mut Verifier<'_>,
    variables: usize,
    equations: &mut Equations,
) -> Result<LeafClaim<Form>, Refused> {
    let mut children = Children::receive(verifier)?;
    let first = verifier.receive_secret(2)?.start;
    let (denominator, inverse) = (Form::of_said(first), Form::of_said(first + 1));
    let Children { p, q } = &children;
    let mut numerator = equations.product(&p[0], &q[1])?;
    numerator.add(Extension::ONE, &equations.product(&p[1], &q[0])?);
    equations.zero("a sum of look-ups", numerator)?;
    let product = equations.product(&q[0], &q[1])?;
    equations.zero("the denominator of a sum", product.minus(&denominator))?;
    let one = equations.product(&denominator, &inverse)?;
    let one = one.minus(&Extension::ONE.into());
    equations.zero("the inverse of a denominator", one)?;
    let mut point: Vec<Extension> = Vec::new();
    loop {
        let step = verifier.challenge();
        let [numerator, denominator] = children.between(step);
        point.insert(0, step);
        if point.len() == variables {
            return Ok(LeafClaim {
                point,
                numerator,
                denominator,
            });
        }
        let lambda = verifier.challenge();
        let mut claim = numerator;
        claim.reserve(2 + 2 * point.len());
        claim.add(lambda, &denominator);
        let mut next = Vec::with_capacity(variables);
        for &coordinate in &point {
            // The claim becomes constant + challenge·(slope − square + challenge·square), where the constant is claim − coordinate·slope.
            let said = verifier.receive_secret(2)?;
            let challenge = verifier.challenge();
            let factors = [challenge - coordinate, challenge * challenge - challenge];
            for (number, factor) in said.zip(factors) {
                claim.add_said(factor, number);
            }
            next.push(challenge);
        }
        point = next;
        children = Children::receive(verifier)?;
        children.sum_is(lambda, claim, equations)?;
    }
}
