//! A matrix product Y = X·W by one sumcheck (Thaler 2013): at a random point (i, j),
//! `Y~(i, j) = Σ_k X~(i, k) · W~(k, j)`.
//!
//! Y is not committed but its two parts, as the evaluation narrows it: `Y + half = 2^shift · narrowed + remainder`.
//! Matrices are padded to powers of two and stored by rows; variables of a point: columns first.

use crate::{
    field::{E, F},
    multilinear::{eq_table, evaluate},
    sumcheck,
    transcript::{Challenges, Prover, Refused, Verifier},
};

/// Binary logarithms of the padded dimensions, and how products are narrowed.
#[derive(Clone, Copy, Debug)]
pub struct Shape {
    /// Rows of X and Y.
    pub rows: usize,
    /// Columns of X, rows of W.
    pub inner: usize,
    /// Columns of W and Y.
    pub columns: usize,
    /// Bits that narrowing takes away.
    pub shift: usize,
}

/// A claimed value of a multilinear polynomial.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Claim {
    /// Where.
    pub point: Vec<E>,
    /// What.
    pub value: E,
}

/// What is left to show after the sumcheck.
#[derive(Clone, Debug)]
pub struct Claims {
    /// Of X, opened by the commitment.
    pub input: Claim,
    /// Of W, which is public: whoever holds it evaluates it.
    pub weights: Claim,
    /// Of narrowed Y, opened by the commitment.
    pub narrowed: Claim,
    /// Of the remainders, at the same point.
    pub remainder: E,
}

/// `half` of the narrowing: 2^(shift − 1).
fn half(shape: &Shape) -> E {
    F(1 << shape.shift >> 1).into()
}

/// The sum that the narrowed value and the remainder stand for.
fn product(shape: &Shape, narrowed: E, remainder: E) -> E {
    narrowed.scale(F(1 << shape.shift)) + remainder - half(shape)
}

/// Proves the product. The values are field elements: X and narrowed Y signed, the remainders within 0..2^shift.
pub fn prove(prover: &mut Prover, shape: &Shape, x: &[F], w: &[F], narrowed: &[F], remainder: &[F]) -> Claims {
    let j = prover.challenges(shape.columns);
    let i = prover.challenges(shape.rows);
    let output: Vec<E> = j.iter().chain(&i).copied().collect();
    let (y, r) = (evaluate(narrowed, &output), evaluate(remainder, &output));
    prover.send_extension(&[y, r]);

    // X~(i, k) and W~(k, j) for all k.
    let weights_i = eq_table(&i);
    let mut x_bound = vec![E::ZERO; 1 << shape.inner];
    for (row, &weight) in x.chunks_exact(1 << shape.inner).zip(&weights_i) {
        for (sum, &value) in x_bound.iter_mut().zip(row) {
            *sum += weight.scale(value);
        }
    }
    let weights_j = eq_table(&j);
    let w_bound = w.chunks_exact(1 << shape.columns).map(|row| E::dot_base(&weights_j, row)).collect();
    let (k, [x_value, w_value]) = sumcheck::prove(prover, x_bound, w_bound);
    prover.send_extension(&[x_value, w_value]);
    claims(i, j, k, output, [x_value, w_value, y, r])
}

/// Checks the sumcheck; gives the claims that are left.
pub fn verify(verifier: &mut Verifier, shape: &Shape) -> Result<Claims, Refused> {
    let j = verifier.challenges(shape.columns);
    let i = verifier.challenges(shape.rows);
    let output: Vec<E> = j.iter().chain(&i).copied().collect();
    let [y, r] = *verifier.receive_extension(2)? else { return Err(Refused::Length) };
    let (k, last) = sumcheck::verify(verifier, shape.inner, product(shape, y, r))?;
    let [x_value, w_value] = *verifier.receive_extension(2)? else { return Err(Refused::Length) };
    if x_value * w_value != last {
        return Err(Refused::Sumcheck("matrix product"));
    }
    Ok(claims(i, j, k, output, [x_value, w_value, y, r]))
}

fn claims(i: Vec<E>, j: Vec<E>, k: Vec<E>, output: Vec<E>, [x, w, y, remainder]: [E; 4]) -> Claims {
    Claims {
        input: Claim { point: k.iter().chain(&i).copied().collect(), value: x },
        weights: Claim { point: j.iter().chain(&k).copied().collect(), value: w },
        narrowed: Claim { point: output, value: y },
        remainder,
    }
}
