//! Claims about the leaves of several sums of fractions become one claim: first all are taken to the same point, and then they are added with
//! random weights.
//!
//! A numerator at a point is `Σ_x eq(point, x)·N(x)`. So one sumcheck of degree 2 reduces a random combination of all claims, each at a point of
//! its own, to the values of all numerators and denominators at one point.

use crate::field::Extension;
use crate::fractions::LeafClaim;
use crate::layout::Layout;
use crate::multilinear::eq;
use crate::party::{Fold, Party};
use crate::transcript::{require, Refused};
use alloc::vec;
use alloc::vec::Vec;

/// A claim about the leaves of all instances.
pub struct Gathered {
    /// The point, and the sums of weights times numerators and denominators there.
    pub leaf: LeafClaim,
    /// The weights of instances.
    pub weights: Vec<Extension>,
}

/// Makes one claim of the claims about each instance. There is one at least.
pub fn gather<P: Party>(
    party: &mut P,
    layout: &Layout,
    fold: &Fold,
    mut claims: Vec<LeafClaim>,
) -> Result<Gathered, Refused> {
    if claims.len() == 1 {
        if let Some(leaf) = claims.pop() {
            let weights = vec![Extension::ONE];
            return Ok(Gathered { leaf, weights });
        }
    }
    let gamma = party.challenge();
    let (point, value) = party.gather(layout, fold, &claims, gamma)?;
    let values = party.gathered(claims.len())?;
    let mut expected = Extension::ZERO;
    let mut power = Extension::ONE;
    for (claim, &[numerator, denominator]) in claims.iter().zip(&values) {
        let place = eq(&claim.point, &point);
        expected += power * place * (numerator + gamma * denominator);
        power *= gamma * gamma;
    }
    require(
        expected == value,
        Refused::Equation("the sumcheck of the leaves of sums"),
    )?;
    let step = party.challenge();
    let mut leaf = LeafClaim {
        point,
        numerator: Extension::ZERO,
        denominator: Extension::ZERO,
    };
    let mut weights = Vec::with_capacity(values.len());
    let mut weight = Extension::ONE;
    for [numerator, denominator] in values {
        leaf.numerator += weight * numerator;
        leaf.denominator += weight * denominator;
        weights.push(weight);
        weight *= step;
    }
    Ok(Gathered { leaf, weights })
}

/// `Σ γ^(2s)·numerator + γ^(2s+1)·denominator` over all claims.
pub fn combined(claims: &[LeafClaim], gamma: Extension) -> Extension {
    let mut sum = Extension::ZERO;
    for claim in claims.iter().rev() {
        sum = sum * gamma * gamma + gamma * claim.denominator + claim.numerator;
    }
    sum
}
