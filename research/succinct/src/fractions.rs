//! A sum of fractions that must be zero, by GKR on the tree that adds them in pairs (Papini, Haböck 2023).
//!
//! Layer ℓ has 2^ℓ fractions p/q; fraction x of it is the sum of fractions 2x and 2x + 1 of layer ℓ + 1:
//! `p = p0·q1 + p1·q0`, `q = q0·q1`. A claim on both polynomials of one layer becomes one on the next by a sumcheck of
//! `Σ_x eq(r, x) · (p0·q1 + p1·q0 + λ·q0·q1)(x)`. The factor eq is left out of the messages (Gruen 2024): the claim is
//! `(1 − r_i)·g(0) + r_i·g(1)` for a round polynomial g of degree 2, said as (g(1) − g(0), leading coefficient), eight
//! field elements and one permutation.

use crate::{
    field::E,
    multilinear::{bind, eq_table},
    transcript::{Challenges, Prover, Refused, Verifier},
};

/// Numerators and denominators of one layer, or their two values at a point.
type Layer = (Vec<E>, Vec<E>);

/// The point among the leaves that is reached, and the values of numerators and denominators there.
pub type LeafClaim = (Vec<E>, E, E);

/// Proves that Σ numerators/denominators = 0, over 2^n ≥ 2 fractions.
pub fn prove(prover: &mut Prover, numerators: Vec<E>, denominators: Vec<E>) -> LeafClaim {
    let mut layers: Vec<Layer> = vec![(numerators, denominators)];
    while let Some((p, q)) = layers.last().filter(|(p, _)| p.len() > 2) {
        let sums = p.chunks_exact(2).zip(q.chunks_exact(2)).map(|(p, q)| (p[0] * q[1] + p[1] * q[0], q[0] * q[1]));
        let next = sums.unzip();
        layers.push(next);
    }
    let (p, q) = layers.pop().expect("there is at least the layer of leaves");
    let mut children = [p[0], p[1], q[0], q[1]];
    prover.send_extension(&children);
    let mut point: Vec<E> = Vec::new();
    loop {
        let step = prover.challenge();
        let (p, q) = join(children, step);
        point.insert(0, step);
        match layers.pop() {
            None => return (point, p, q),
            Some(layer) => (point, children) = prove_layer(prover, layer, &point),
        }
    }
}

/// One layer's sumcheck; gives its point, and the four values there, which are said.
fn prove_layer(prover: &mut Prover, (p, q): Layer, claimed_at: &[E]) -> (Vec<E>, [E; 4]) {
    let lambda = prover.challenge();
    let part = |values: &[E], odd: usize| -> Vec<E> { values.chunks_exact(2).map(|pair| pair[odd]).collect() };
    let (mut p0, mut q0, mut q1) = (part(&p, 0), part(&q, 0), part(&q, 1));
    // p1 + λ·q1: then the summand is p0·q1 + q0·(p1 + λ·q1).
    let mut mixed: Vec<E> = part(&p, 1).iter().zip(&q1).map(|(&p1, &q1)| p1 + lambda * q1).collect();
    drop((p, q));
    // eq over the variables after the first.
    let mut weights = eq_table(&claimed_at[1..]);
    let mut point = Vec::with_capacity(claimed_at.len());
    for _ in 0..claimed_at.len() {
        let (mut at_zero, mut at_one, mut leading) = (E::ZERO, E::ZERO, E::ZERO);
        for (index, &weight) in weights.iter().enumerate() {
            let pair = |values: &[E]| (values[2 * index], values[2 * index + 1]);
            let ((a0, a1), (b0, b1), (c0, c1), (d0, d1)) = (pair(&p0), pair(&q1), pair(&q0), pair(&mixed));
            at_zero += weight * (a0 * b0 + c0 * d0);
            at_one += weight * (a1 * b1 + c1 * d1);
            leading += weight * ((a1 - a0) * (b1 - b0) + (c1 - c0) * (d1 - d0));
        }
        prover.send_extension(&[at_one - at_zero, leading]);
        let challenge = prover.challenge();
        for values in [&mut p0, &mut q0, &mut q1, &mut mixed] {
            bind(values, challenge);
        }
        // eq's sum over both values of a variable is one.
        weights = weights.chunks_exact(2).map(|pair| pair[0] + pair[1]).collect();
        point.push(challenge);
    }
    let children = [p0[0], mixed[0] - lambda * q1[0], q0[0], q1[0]];
    prover.send_extension(&children);
    (point, children)
}

/// Checks that 2^`variables` fractions add up to zero, given that the claim on the leaves holds.
#[inline(always)]
pub fn verify(verifier: &mut Verifier, variables: usize) -> Result<LeafClaim, Refused> {
    let mut children = receive_children(verifier)?;
    let [p0, p1, q0, q1] = children;
    if p0 * q1 + p1 * q0 != E::ZERO || q0 * q1 == E::ZERO {
        return Err(Refused::Lookup);
    }
    let mut point = Vec::new();
    for layer in 1.. {
        let step = verifier.challenge();
        let (p, q) = join(children, step);
        point.insert(0, step);
        if layer == variables {
            return Ok((point, p, q));
        }
        let lambda = verifier.challenge();
        let mut claim = p + lambda * q;
        let mut next = Vec::with_capacity(layer + 1);
        for &coordinate in &point {
            let [slope, leading] = *verifier.receive_extension(2)? else { return Err(Refused::Length) };
            let challenge = verifier.challenge();
            let constant = claim - coordinate * slope;
            claim = constant + challenge * (slope - leading + challenge * leading);
            next.push(challenge);
        }
        point = next;
        children = receive_children(verifier)?;
        let [p0, p1, q0, q1] = children;
        if p0 * q1 + q0 * (p1 + lambda * q1) != claim {
            return Err(Refused::Sumcheck("sum of fractions"));
        }
    }
    Err(Refused::Parameters)
}

fn receive_children(verifier: &mut Verifier) -> Result<[E; 4], Refused> {
    verifier.receive_extension(4)?.try_into().map_err(|_| Refused::Length)
}

/// The values between the children, at `step`: (numerator, denominator).
fn join([p0, p1, q0, q1]: [E; 4], step: E) -> (E, E) {
    (p0 + step * (p1 - p0), q0 + step * (q1 - q0))
}
