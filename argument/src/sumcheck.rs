//! Sumcheck (Lund, Fortnow, Karloff and Nisan 1992): a claim about the sum of a polynomial over {0, 1}^n becomes a claim about its value at a
//! random point.
//!
//! In each round the prover says a polynomial `g` in one variable: the sum over all other variables that are still free. It says all
//! coefficients but the linear one, which follows from `g(0) + g(1) = claim`.

use crate::field::Extension;
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

/// Reduces claims about sums over tensors of several sizes: each has a number of variables, and claims a sum over {0, 1}^variables of a
/// polynomial of degree up to `degree`. The variables are bound from the highest to the lowest, and a smaller sum joins when the
/// variables that are left are its own. So the first coordinates of the point are those of each sum. Returns the point, and what the values of
/// all polynomials there have to add up to.
pub fn verify_joined(
    verifier: &mut Verifier<'_>,
    sums: &[(usize, Extension)],
    degree: usize,
) -> Result<(Vec<Extension>, Extension), Refused> {
    let variables = sums.iter().map(|(variables, _)| *variables).max();
    let variables = variables.unwrap_or_default();
    let joining = |left: usize| -> Extension {
        let joining = sums.iter().filter(|(variables, _)| *variables == left);
        joining.map(|(_, claim)| *claim).sum()
    };
    let mut claim = Extension::ZERO;
    let mut point = vec![Extension::ZERO; variables];
    for variable in (0..variables).rev() {
        claim += joining(variable + 1);
        let coefficients = verifier.receive_extension(degree)?;
        point[variable] = verifier.challenge();
        claim = value_after_round(claim, coefficients, point[variable]);
    }
    Ok((point, claim + joining(0)))
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
    use crate::field::lazy::Sum;
    use crate::multilinear::bind;
    use crate::transcript::Prover;
    use rayon::prelude::*;

    /// Values that one core works on at a time.
    const PIECE: usize = 1 << 12;

    /// Proves the sum of `a · b` over all values of two multilinear polynomials. Returns the point, and the values of the two there.
    pub fn product(
        prover: &mut Prover,
        mut a: Vec<Extension>,
        mut b: Vec<Extension>,
    ) -> (Vec<Extension>, [Extension; 2]) {
        let mut point = Vec::with_capacity(a.len().ilog2() as usize);
        while a.len() > 1 {
            let pieces = a.par_chunks(PIECE).zip(b.par_chunks(PIECE));
            let sums = pieces.map(|(a, b)| {
                let (mut constant, mut square) = (Sum::default(), Sum::default());
                for (a, b) in a.as_chunks::<2>().0.iter().zip(b.as_chunks::<2>().0) {
                    constant.add(a[0], b[0]);
                    square.add(a[1] - a[0], b[1] - b[0]);
                }
                [constant, square].map(Sum::reduce)
            });
            let add = |a: [Extension; 2], b: [Extension; 2]| [a[0] + b[0], a[1] + b[1]];
            let [constant, square] = sums.reduce(Default::default, add);
            prover.send_extension(&[constant, square]);
            let challenge = prover.challenge();
            bind(&mut a, challenge);
            bind(&mut b, challenge);
            point.push(challenge);
        }
        (point, [a[0], b[0]])
    }
}
