//! A sum of fractions that is zero, shown by GKR on the tree that adds them in pairs (Papini and Haböck 2023, eprint 2023/1284).
//!
//! Layer ℓ of the tree has 2^ℓ fractions p/q. Fraction x of it is the sum of fractions 2x and 2x + 1 of layer ℓ + 1:
//! `p = p0·q1 + p1·q0` and `q = q0·q1`. A claim about p and q at a point of one layer becomes a claim about both at a point of the next one,
//! by a sumcheck of `Σ_x eq(r, x) · (p0·q1 + p1·q0 + λ·q0·q1)(x)`. The factor eq is left out of what the prover says (Gruen 2024, eprint
//! 2024/108): a round polynomial g has degree 2, and `(1 − r_i)·g(0) + r_i·g(1)` is the claim.

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

/// The prover's side.
#[cfg(feature = "prove")]
pub mod prove {
    use super::*;
    use crate::multilinear::eq_table;
    use crate::transcript::Prover;
    use rayon::prelude::*;

    /// Fractions below which a loop is not worth sharing among cores.
    const SHARED: usize = 1 << 12;

    /// Numerators and denominators of one layer.
    type Layer = (Vec<Extension>, Vec<Extension>);

    /// Proves that Σ numerators/denominators = 0, over 2^n ≥ 2 fractions.
    pub fn sum(
        prover: &mut Prover,
        numerators: Vec<Extension>,
        denominators: Vec<Extension>,
    ) -> LeafClaim {
        let mut layers: Vec<Layer> = vec![(numerators, denominators)];
        while let Some((p, q)) = layers.last().filter(|(p, _)| p.len() > 2) {
            let pairs = p
                .par_chunks_exact(2)
                .zip(q.par_chunks_exact(2))
                .with_min_len(SHARED);
            let next = pairs
                .map(|(p, q)| {
                    Children {
                        p: [p[0], p[1]],
                        q: [q[0], q[1]],
                    }
                    .sum()
                })
                .unzip();
            layers.push(next);
        }
        let mut children = match layers.pop() {
            Some((p, q)) => Children {
                p: [p[0], p[1]],
                q: [q[0], q[1]],
            },
            None => {
                return LeafClaim {
                    point: vec![],
                    numerator: Extension::ZERO,
                    denominator: Extension::ONE,
                }
            }
        };
        send(prover, &children);
        let mut point: Vec<Extension> = Vec::new();
        loop {
            let step = prover.challenge();
            let (numerator, denominator) = children.between(step);
            point.insert(0, step);
            match layers.pop() {
                None => {
                    return LeafClaim {
                        point,
                        numerator,
                        denominator,
                    }
                }
                Some(layer) => (point, children) = prove_layer(prover, layer, &point),
            }
        }
    }

    fn send(prover: &mut Prover, children: &Children) {
        let Children { p, q } = children;
        prover.send_extension(&[p[0], p[1], q[0], q[1]]);
    }

    /// The parts of a layer that a sumcheck is about, halved in each round.
    struct Parts {
        p0: Vec<Extension>,
        q0: Vec<Extension>,
        q1: Vec<Extension>,
        /// p1 + λ·q1: with it, the summand is p0·q1 + q0·mixed.
        mixed: Vec<Extension>,
    }

    impl Parts {
        fn of((p, q): Layer, lambda: Extension) -> Self {
            let part = |values: &[Extension], odd: usize| {
                values.par_chunks_exact(2).map(|pair| pair[odd]).collect()
            };
            let mixed = p
                .par_chunks_exact(2)
                .zip(q.par_chunks_exact(2))
                .map(|(p, q)| p[1] + lambda * q[1]);
            Self {
                mixed: mixed.collect(),
                p0: part(&p, 0),
                q0: part(&q, 0),
                q1: part(&q, 1),
            }
        }

        /// Σ of `weights` times the round polynomial: its values at 0 and 1, and its leading coefficient.
        fn round(&self, weights: &[Extension]) -> [Extension; 3] {
            let pair = |values: &[Extension], at: usize| (values[2 * at], values[2 * at + 1]);
            let term = |(at, &weight): (usize, &Extension)| {
                let ((a0, a1), (b0, b1)) = (pair(&self.p0, at), pair(&self.q1, at));
                let ((c0, c1), (d0, d1)) = (pair(&self.q0, at), pair(&self.mixed, at));
                let values = [
                    a0 * b0 + c0 * d0,
                    a1 * b1 + c1 * d1,
                    (a1 - a0) * (b1 - b0) + (c1 - c0) * (d1 - d0),
                ];
                values.map(|value| weight * value)
            };
            let add =
                |a: [Extension; 3], b: [Extension; 3]| [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
            let terms = weights
                .par_iter()
                .enumerate()
                .with_min_len(SHARED)
                .map(term);
            terms.reduce(|| [Extension::ZERO; 3], add)
        }

        fn bind(&mut self, challenge: Extension) {
            for values in [&mut self.p0, &mut self.q0, &mut self.q1, &mut self.mixed] {
                let pairs = values.par_chunks_exact(2).with_min_len(SHARED);
                *values = pairs
                    .map(|pair| pair[0] + challenge * (pair[1] - pair[0]))
                    .collect();
            }
        }
    }

    /// One layer's sumcheck. Returns its point, and the four values there, which are said.
    fn prove_layer(
        prover: &mut Prover,
        layer: Layer,
        claimed_at: &[Extension],
    ) -> (Vec<Extension>, Children) {
        let lambda = prover.challenge();
        let mut parts = Parts::of(layer, lambda);
        // eq over the variables after the first one.
        let mut weights = eq_table(&claimed_at[1..]);
        let mut point = Vec::with_capacity(claimed_at.len() + 1);
        for _ in claimed_at {
            let [zero, one, square] = parts.round(&weights);
            prover.send_extension(&[one - zero, square]);
            let challenge = prover.challenge();
            parts.bind(challenge);
            // The sum of eq over both values of a variable is 1.
            weights = weights
                .chunks_exact(2)
                .map(|pair| pair[0] + pair[1])
                .collect();
            point.push(challenge);
        }
        let Parts { p0, q0, q1, mixed } = parts;
        let children = Children {
            p: [p0[0], mixed[0] - lambda * q1[0]],
            q: [q0[0], q1[0]],
        };
        send(prover, &children);
        (point, children)
    }
}
