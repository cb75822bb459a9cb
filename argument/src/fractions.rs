//! A sum of fractions that is zero, shown by GKR on the tree that adds them in pairs (Papini and Haböck 2023, eprint 2023/1284).
//!
//! Layer ℓ of the tree has 2^ℓ fractions p/q. Fraction x of it is the sum of fractions 2x and 2x + 1 of layer ℓ + 1:
//! `p = p0·q1 + p1·q0` and `q = q0·q1`. A claim about p and q at a point of one layer becomes a claim about both at a point of the next one,
//! by a sumcheck of `Σ_x eq(r, x) · (p0·q1 + p1·q0 + λ·q0·q1)(x)`. The factor eq is left out of what the prover says (Gruen 2024, eprint
//! 2024/108): a round polynomial g has degree 2, and `(1 − r_i)·g(0) + r_i·g(1)` is the claim.

#[cfg(feature = "prove")]
mod leaves;
#[cfg(feature = "prove")]
pub mod prove;

use crate::field::Extension;
use crate::transcript::{require, Challenges, Refused, Verifier};
use alloc::vec::Vec;

/// A point of the leaves, and the values of their numerators and denominators there. It is left to show.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LeafClaim {
    /// The point.
    pub point: Vec<Extension>,
    /// Of the numerators.
    pub numerator: Extension,
    /// Of the denominators.
    pub denominator: Extension,
}

/// The values of p at 2x and 2x + 1, and those of q.
#[derive(Clone, Copy)]
struct Children {
    p: [Extension; 2],
    q: [Extension; 2],
}

impl Children {
    fn receive(verifier: &mut Verifier<'_>) -> Result<Self, Refused> {
        let values = verifier.receive_extension(4)?;
        Ok(Self {
            p: [values[0], values[1]],
            q: [values[2], values[3]],
        })
    }

    /// Numerator and denominator of the sum of both.
    fn sum(self) -> (Extension, Extension) {
        let Self { p, q } = self;
        (p[0] * q[1] + p[1] * q[0], q[0] * q[1])
    }

    /// Numerator and denominator between both, at `step`.
    fn between(self, step: Extension) -> (Extension, Extension) {
        let at = |[zero, one]: [Extension; 2]| zero + step * (one - zero);
        (at(self.p), at(self.q))
    }
}

/// Checks that 2^`variables` fractions add up to zero, if the claim about the leaves holds that is returned.
pub fn verify(verifier: &mut Verifier<'_>, variables: usize) -> Result<LeafClaim, Refused> {
    let mut children = Children::receive(verifier)?;
    let (numerator, denominator) = children.sum();
    let holds = numerator == Extension::ZERO && denominator != Extension::ZERO;
    require(holds, Refused::Equation("a sum of look-ups"))?;
    let mut point: Vec<Extension> = Vec::new();
    loop {
        let step = verifier.challenge();
        let (numerator, denominator) = children.between(step);
        point.insert(0, step);
        if point.len() == variables {
            return Ok(LeafClaim {
                point,
                numerator,
                denominator,
            });
        }
        let lambda = verifier.challenge();
        let mut claim = numerator + lambda * denominator;
        let mut next = Vec::with_capacity(variables);
        for &coordinate in &point {
            let said = verifier.receive_extension(2)?;
            let (slope, square) = (said[0], said[1]);
            let challenge = verifier.challenge();
            let constant = claim - coordinate * slope;
            claim = constant + challenge * (slope - square + challenge * square);
            next.push(challenge);
        }
        point = next;
        children = Children::receive(verifier)?;
        let (numerator, denominator) = children.sum();
        let holds = numerator + lambda * denominator == claim;
        require(holds, Refused::Equation("a layer of a sum of look-ups"))?;
    }
}
