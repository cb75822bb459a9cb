//! Sumcheck for the sum of a product of two multilinear polynomials: what a matrix product and a batch of openings are.
//! (Lund, Fortnow, Karloff, Nisan 1992; for matrix products Thaler 2013.)
//!
//! Round polynomials c0 + c1·X + c2·X² are said as (c0, c2): the claim gives c1. Eight field elements, one permutation.

use crate::{
    field::E,
    multilinear::bind,
    transcript::{Challenges, Prover, Refused, Verifier},
};

/// Proves `Σ a·b`; gives the point and the two values there, which are claims now. They are said.
pub fn prove(prover: &mut Prover, mut a: Vec<E>, mut b: Vec<E>) -> (Vec<E>, [E; 2]) {
    let mut point = Vec::new();
    while a.len() > 1 {
        let (mut constant, mut leading) = (E::ZERO, E::ZERO);
        for (a, b) in a.chunks_exact(2).zip(b.chunks_exact(2)) {
            constant += a[0] * b[0];
            leading += (a[1] - a[0]) * (b[1] - b[0]);
        }
        prover.send_extension(&[constant, leading]);
        let challenge = prover.challenge();
        bind(&mut a, challenge);
        bind(&mut b, challenge);
        point.push(challenge);
    }
    (point, [a[0], b[0]])
}

/// Reduces the claim that `Σ a·b = claim` over `variables` variables to the point and the value of a·b there.
#[inline(always)]
pub fn verify(verifier: &mut Verifier, variables: usize, mut claim: E) -> Result<(Vec<E>, E), Refused> {
    let mut point = Vec::with_capacity(variables);
    for _ in 0..variables {
        let [constant, leading] = *verifier.receive_extension(2)? else { return Err(Refused::Length) };
        let challenge = verifier.challenge();
        let linear = claim - constant - constant - leading;
        claim = constant + challenge * (linear + challenge * leading);
        point.push(challenge);
    }
    Ok((point, claim))
}
