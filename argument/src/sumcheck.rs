//! Sumcheck (Lund, Fortnow, Karloff and Nisan 1992): a claim about the sum of a polynomial over {0, 1}^n becomes a claim about its value at a
//! random point.
//!
//! In each round the prover states a polynomial `g` in one variable: the sum over all other variables that are still free. It states all
//! coefficients but the linear one, which follows from `g(0) + g(1) = claim`.

use crate::field::Extension;
use crate::form::Form;
use crate::transcript::{Challenges, Refused, Verifier};
use alloc::vec;
use alloc::vec::Vec;

/// Reduces the claim that the sum over {0, 1}^`variables` of a polynomial of degree `degree` in each variable is `claim`. Returns a point, and
/// the value that the polynomial has to have there.
#[inline(always)]
pub fn verify(
    verifier: &mut Verifier<'_>,
    variables: usize,
    degree: usize,
    mut claim: Extension,
) -> Result<(Vec<Extension>, Extension), Refused> {
    let mut point = Vec::with_capacity(variables);
    for _ in 0..variables {
        let coefficients = verifier.receive_extension(degree)?;
        let challenge = verifier.challenge();
        claim = value_after_round(claim, coefficients, challenge);
        point.push(challenge);
    }
    Ok((point, claim))
}

/// [`verify`] where the prover states its polynomials with pads, and the claim is secret. The value that is left is
/// `claim·Π t + Σ coefficient·(t^i − t)·Π later t`, for the challenges t, and 1 − 2t in place of t^i − t for constants.
pub fn verify_secret(
    verifier: &mut Verifier<'_>,
    variables: usize,
    degree: usize,
    mut claim: Form,
) -> Result<(Vec<Extension>, Form), Refused> {
    let mut point = Vec::with_capacity(variables);
    let mut rounds = Vec::with_capacity(variables);
    for _ in 0..variables {
        rounds.push(verifier.receive_secret(degree)?);
        point.push(verifier.challenge());
    }
    let all = point
        .iter()
        .copied()
        .fold(Extension::ONE, |product, challenge| product * challenge);
    claim.scale(all);
    claim.reserve(variables * degree);
    // From the last round back, the product of all later challenges is known.
    let mut later = Extension::ONE;
    for (&challenge, said) in point.iter().zip(&rounds).rev() {
        let mut power = challenge;
        for (place, number) in said.clone().enumerate() {
            let factor = match place {
                0 => Extension::ONE - challenge - challenge,
                _ => {
                    power *= challenge;
                    power - challenge
                }
            };
            claim.add_said(later * factor, number);
        }
        later *= challenge;
    }
    Ok((point, claim))
}

/// A point of sums over tensors of several sizes.
#[derive(Clone, Debug, Default)]
pub struct JoinedPoint {
    /// The variables within an instance. The first coordinates are those of a smaller sum.
    pub own: Vec<Extension>,
    /// The variables of instances.
    pub instances: Vec<Extension>,
    /// Entry `i` is the product of `1 − coordinate` from coordinate `i` of `own` on.
    absent: Vec<Extension>,
    /// Likewise of all coordinates of `instances`.
    no_instances: Extension,
}

impl JoinedPoint {
    /// From all coordinates, those of instances last.
    pub fn new(mut own: Vec<Extension>, instances: usize) -> Self {
        let instances = own.split_off(own.len() - instances);
        let mut absent = vec![Extension::ONE; own.len() + 1];
        for (index, &coordinate) in own.iter().enumerate().rev() {
            absent[index] = absent[index + 1] * (Extension::ONE - coordinate);
        }
        let product = |product, &coordinate| product * (Extension::ONE - coordinate);
        let no_instances = instances.iter().fold(Extension::ONE, product);
        Self {
            own,
            instances,
            absent,
            no_instances,
        }
    }

    /// What the value of a sum is multiplied with that has so many variables within an instance: the product of `1 − coordinate` of all
    /// variables that it does not have.
    pub fn absent(&self, variables: usize, over_instances: bool) -> Extension {
        let absent = self.absent[variables];
        if over_instances {
            absent
        } else {
            absent * self.no_instances
        }
    }
}

/// Reduces the claim about a sum of sums over tensors of several sizes, of polynomials of degree up to `degree`. Where a sum does not have a
/// variable, its polynomial is multiplied with `1 − variable`, so that it counts once. The largest sum has `variables` within an instance, and
/// there are `instances` variables of instances. They are bound from the highest to the lowest, those of instances first. Returns the point,
/// and what the values there add up to.
pub fn verify_joined(
    verifier: &mut Verifier<'_>,
    variables: usize,
    instances: usize,
    degree: usize,
    claim: Form,
) -> Result<(JoinedPoint, Form), Refused> {
    let (mut point, value) = verify_secret(verifier, variables + instances, degree, claim)?;
    point.reverse();
    Ok((JoinedPoint::new(point, instances), value))
}

/// `g(challenge)` for the round polynomial whose coefficients but the linear one are given, from the constant up, and for which
/// `g(0) + g(1) = claim`.
#[inline(always)]
fn value_after_round(
    claim: Extension,
    coefficients: &[Extension],
    challenge: Extension,
) -> Extension {
    let Some((&constant, higher)) = coefficients.split_first() else {
        return claim;
    };
    let linear = claim - constant - constant - higher.iter().copied().sum();
    let above = higher
        .iter()
        .rev()
        .fold(Extension::ZERO, |sum, &coefficient| {
            (sum + coefficient) * challenge
        });
    constant + (linear + above) * challenge
}

/// The prover's side.
#[cfg(feature = "prove")]
pub mod prove {
    use super::*;
    use crate::field::lazy::LazySum;
    use crate::multilinear::bind;
    use crate::transcript::Prover;
    use rayon::prelude::*;

    /// Values that one core works on at a time.
    const PIECE: usize = 1 << 12;

    /// Proves the sum of all `a · b` of pairs of polynomials in so many variables, which lie one after the other, and states its polynomials with
    /// `state`. Returns the point. What is left of `a` and `b` are the values there.
    pub fn products(
        prover: &mut Prover,
        say: fn(&mut Prover, &[Extension]),
        a: &mut Vec<Extension>,
        b: &mut Vec<Extension>,
        variables: usize,
    ) -> Vec<Extension> {
        let mut point = Vec::with_capacity(variables);
        for _ in 0..variables {
            let pieces = a.par_chunks(PIECE).zip(b.par_chunks(PIECE));
            let sums = pieces.map(|(a, b)| {
                let (mut constant, mut square) = (LazySum::default(), LazySum::default());
                for (a, b) in a.as_chunks::<2>().0.iter().zip(b.as_chunks::<2>().0) {
                    constant.add(a[0], b[0]);
                    square.add(a[1] - a[0], b[1] - b[0]);
                }
                [constant, square].map(LazySum::reduce)
            });
            let add = |a: [Extension; 2], b: [Extension; 2]| [a[0] + b[0], a[1] + b[1]];
            let [constant, square] = sums.reduce(Default::default, add);
            say(prover, &[constant, square]);
            let challenge = prover.challenge();
            bind(a, challenge);
            bind(b, challenge);
            point.push(challenge);
        }
        point
    }
}
