//! Claims about the leaves of several sums of fractions become one claim: first all are taken to the same point, and then they are added with
//! random weights.
//!
//! A numerator at a point is `Σ_x eq(point, x)·N(x)`. So one sumcheck of degree 2 reduces a random combination of all claims, each at a point of
//! its own, to the values of all numerators and denominators at one point.

use crate::field::Extension;
use crate::form::Secret;
use crate::fractions::LeafClaim;
use crate::layout::LookupLayout;
use crate::multilinear::eq;
use crate::party::{combine, Fold, Party};
use crate::transcript::Refused;
use alloc::vec;
use alloc::vec::Vec;

/// A claim about the leaves of all instances.
pub struct Gathered<V> {
    /// The point, and the sums of weights times numerators and denominators there.
    pub leaf: LeafClaim<V>,
    /// The weights of instances.
    pub weights: Vec<Extension>,
}

/// Makes one claim of the claims about each instance. There is one at least.
pub fn gather<P: Party>(
    party: &mut P,
    layout: &LookupLayout,
    fold: &Fold,
    mut claims: Vec<LeafClaim<P::Value>>,
) -> Result<Gathered<P::Value>, Refused> {
    if claims.len() == 1 {
        if let Some(leaf) = claims.pop() {
            let weights = vec![Extension::ONE];
            return Ok(Gathered { leaf, weights });
        }
    }
    let gamma = party.challenge();
    let (point, value) = party.gather(layout, fold, &claims, gamma)?;
    let values = party.gathered(claims.len())?;
    let mut expected = P::Value::default();
    let mut power = Extension::ONE;
    for (claim, values) in claims.iter().zip(&values) {
        let place = eq(&claim.point, &point);
        for value in values {
            expected.add(power * place, value);
            power *= gamma;
        }
    }
    party.zero("the sumcheck of the leaves of sums", expected.minus(&value))?;
    let step = party.challenge();
    let mut leaf = LeafClaim {
        point,
        numerator: P::Value::default(),
        denominator: P::Value::default(),
    };
    let mut weights = Vec::with_capacity(values.len());
    let mut weight = Extension::ONE;
    for [numerator, denominator] in values {
        leaf.numerator.add(weight, &numerator);
        leaf.denominator.add(weight, &denominator);
        weights.push(weight);
        weight *= step;
    }
    Ok(Gathered { leaf, weights })
}

/// `Σ γ^(2s)·numerator + γ^(2s+1)·denominator` over all claims.
pub fn combined<V: Secret>(claims: &[LeafClaim<V>], gamma: Extension) -> V {
    let values = claims
        .iter()
        .flat_map(|claim| [&claim.numerator, &claim.denominator]);
    combine(values, gamma)
}
