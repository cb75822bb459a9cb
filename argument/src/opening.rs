//! The end of an argument: everything that it left to show of secret values, and of what was committed to, is shown by one opening of a
//! polynomial that is uniform.
//!
//! There are columns f, with values that are claimed at a point z as sums of theirs; a random polynomial g; and U, random to its end, two
//! entries of which are one pad each. All are committed to before the first challenge.
//!
//! 1. A combination `M = Σ w·f + ψ·g` is uniform. The prover states `y₁ = Σ w₀·f(z)` and `g(z)` with pads, and then `y = M(z)` and `U(z)` as they are:
//!    the pads after the last one that is used are as good as a mask for the second. One more equation states what y is. The claimed values are
//!    in it, because the coefficients by which they are sums of columns are parts of w.
//! 2. All equations become one, `Σ α·a·b + L(u) = 0`. For masks a* and b*, which are pads, the prover states `Σ α·(a·b* + a*·b)` and `Σ α·a*·b*` with
//!    pads, and then all `a + ρ·a*` and `b + ρ·b*`, which are uniform. So every equation is linear in pads, and all become `⟨ω, U⟩ = δ`.
//! 3. `F = M + ξ·U` is uniform, and with `⟨ω, M⟩`, which the prover states, one sumcheck of `Σ (eq(z, x) + η·ω(x))·F(x)` shows both sums. What is left is
//!    a value of F, which [`crate::commitment`] opens.
//!
//! This is Cramer and Damgård (CRYPTO 98), as in Longfellow (Frigo and shelat, eprint 2024/2010), with one mask for the opening and the pads.

use crate::field::{Extension, Goldilocks};
use crate::form::{Equations, Form, Secret};
use crate::multilinear::{eq, eq_table};
use crate::sumcheck;
use crate::transcript::{require, work, Challenges, Refused};
use crate::verify::Verifying;
use alloc::vec::Vec;
use core::ops::Range;

/// Bits of the proofs of work before columns are combined, before claims are added to the combination, and before U is.
const WORK: u32 = 16;
/// Columns that hide others: the coefficients of g, and U.
pub const RANDOM: usize = 3;
/// Entries of U after the last pad, of two entries each, which make U's value at a point uniform.
const FREE: usize = 4;
/// x, of which and 1 an element of the extension is a sum.
const X: Extension = Extension([Goldilocks::ZERO, Goldilocks::ONE]);

/// What is claimed of columns at a point: the sum of columns times these coefficients.
pub struct ColumnSum<V> {
    /// One for each column, but for those of [`RANDOM`].
    pub coefficients: Vec<Extension>,
    /// The sum.
    pub value: V,
}

/// What is opened.
pub struct OpenedColumns {
    /// The weights of all columns.
    pub weights: Vec<Extension>,
    /// The point.
    pub point: Vec<Extension>,
    /// The value there.
    pub value: Extension,
}

/// Whether a column with so many variables has so many pads, and the free entries after them.
pub fn is_room(pads: usize, variables: usize) -> bool {
    2 * pads + FREE <= 1 << variables
}

/// What is random about the combination of all columns.
fn combination(challenges: &mut impl Challenges, columns: usize) -> Vec<Extension> {
    let variables = columns.next_power_of_two().ilog2() as usize;
    let mut weights = eq_table(&challenges.challenges(variables));
    weights.truncate(columns);
    weights
}

/// How many columns claims are about.
fn count<V>(sums: &[ColumnSum<V>]) -> usize {
    sums.first().map_or(0, |sum| sum.coefficients.len())
}

/// Adds the coefficients of all sums, times powers of `chi` from the first on.
fn add_sums<V>(weights: &mut [Extension], sums: &[ColumnSum<V>], chi: Extension) {
    let mut power = chi;
    for sum in sums {
        for (weight, &coefficient) in weights.iter_mut().zip(&sum.coefficients) {
            *weight += power * coefficient;
        }
        power *= chi;
    }
}

/// The weights of M, whose random columns are from number `first` on.
fn with_mask(mut weights: Vec<Extension>, first: usize, psi: Extension) -> Vec<Extension> {
    weights.splice(first..first, [psi, psi * X, Extension::ZERO]);
    weights
}

/// Step 1: the weights of M, and what M and U are at the point.
fn values(
    verifying: &mut Verifying<'_, '_>,
    first: usize,
    sums: &[ColumnSum<Form>],
) -> Result<(Vec<Extension>, [Extension; 2]), Refused> {
    let verifier = &mut *verifying.verifier;
    work::check_work(verifier, WORK, "the combination of columns")?;
    let mut weights = combination(verifier, count(sums));
    let [sum, of_g] = pair(verifier.receive_secret(2)?);
    work::check_work(verifier, WORK, "the sums of columns")?;
    let [chi, psi] = [0, 1].map(|_| verifier.challenge());
    add_sums(&mut weights, sums, chi);
    let there = verifier.receive_extension(2)?;
    let mut rest = Form::of_said(sum);
    rest.add_said(psi, of_g);
    let mut power = chi;
    for sum in sums {
        rest.add(power, &sum.value);
        power *= chi;
    }
    rest.add_known(-there[0]);
    verifying
        .equations
        .zero("the columns of a commitment", rest)?;
    Ok((with_mask(weights, first, psi), [there[0], there[1]]))
}

/// All equations of an argument that was read up to its columns' values. The prover reads its own words so.
pub fn equations(
    mut verifying: Verifying<'_, '_>,
    first: usize,
    sums: &[ColumnSum<Form>],
) -> Result<Equations, Refused> {
    values(&mut verifying, first, sums)?;
    Ok(verifying.equations)
}

/// The numbers of two secret values.
fn pair(numbers: Range<usize>) -> [usize; 2] {
    [numbers.start, numbers.start + 1]
}

/// What step 2 comes to: the sum of secret values, times these coefficients, and of what is known, is zero.
struct LinearEquation {
    coefficients: Vec<Extension>,
    known: Extension,
}

/// What the prover states in step 2, and the challenges.
struct MaskedSums<'a> {
    tau: Extension,
    /// The number of the first mask.
    masks: usize,
    /// The numbers of the two sums with masks.
    sums: [usize; 2],
    rho: Extension,
    factors: &'a [Extension],
    theta: Extension,
}

impl LinearEquation {
    /// For so many secret values.
    fn new(equations: &Equations, said: &MaskedSums<'_>, count: usize) -> Self {
        let mut combined = equations.combined(said.tau, count);
        let factors = said.factors.as_chunks::<2>().0;
        for (&alpha, [a, b]) in combined.gates.iter().zip(factors) {
            combined.known += alpha * *a * *b;
        }
        let mut power = said.rho;
        for sum in said.sums {
            combined.said[sum] -= power;
            power *= said.rho;
        }
        // What was stated of each factor is the factor and its mask times ρ. A mask is a value that was stated as zero.
        let mut weight = Extension::ONE;
        for (place, &factor) in said.factors.iter().enumerate() {
            weight *= said.theta;
            combined.known -= weight * factor;
            combined.said[said.masks + place] -= weight * said.rho;
        }
        let mut weight = Extension::ONE;
        let next = || {
            weight *= said.theta;
            weight
        };
        equations.add_factors(next, &mut combined);
        Self {
            coefficients: combined.said,
            known: combined.known,
        }
    }

    /// The multilinear polynomial of the coefficients of U's entries, at a point.
    fn at(&self, point: &[Extension]) -> Extension {
        let bits = self.coefficients.len().next_power_of_two().ilog2() as usize;
        let (pads, above) = point[1..].split_at(bits);
        // Two small tables in place of one for all pads
        let (low, high) = pads.split_at(bits / 2);
        let (low, high) = (eq_table(low), eq_table(high));
        let rows = self.coefficients.chunks(low.len()).zip(&high);
        let sum = rows.map(|(row, &weight)| weight * Extension::dot_of_extensions(&low, row));
        let sum: Extension = sum.sum();
        let absent = above
            .iter()
            .fold(sum, |product, &r| product * (Extension::ONE - r));
        (Extension::ONE - point[0] + X * point[0]) * absent
    }
}

/// The end of an argument as a verifier reads it. It holds if `left` is `expected`.
#[doc(hidden)]
pub struct End {
    /// What is opened then.
    pub opened: OpenedColumns,
    /// The coefficients of pads, and what their sum is.
    pub omega: Vec<Extension>,
    /// See there.
    pub delta: Extension,
    /// The weights of U and of the pads' sum.
    pub xi: Extension,
    /// See there.
    pub eta: Extension,
    /// What the sumcheck leaves.
    pub left: Extension,
    /// What it has to leave.
    pub expected: Extension,
}

/// Checks all that is left but the opening, which it returns. About columns with so many variables as the point has `sums` are claimed there. The
/// random columns are from number `first` on.
pub fn verify(
    verifying: Verifying<'_, '_>,
    point: &[Extension],
    first: usize,
    sums: &[ColumnSum<Form>],
) -> Result<OpenedColumns, Refused> {
    let end = read(verifying, point, first, sums)?;
    let holds = end.left == end.expected;
    require(
        holds,
        Refused::Equation("the sumcheck of an argument's end"),
    )?;
    Ok(end.opened)
}

/// Reads the end of an argument.
#[doc(hidden)]
pub fn read(
    mut verifying: Verifying<'_, '_>,
    point: &[Extension],
    first: usize,
    sums: &[ColumnSum<Form>],
) -> Result<End, Refused> {
    let (mut weights, there) = values(&mut verifying, first, sums)?;
    let Verifying {
        verifier,
        equations,
    } = verifying;
    let tau = verifier.challenge();
    let count = 2 * equations.count_of_gates();
    let masks = verifier.masks(count).start;
    let sums = pair(verifier.receive_secret(2)?);
    let pads = sums[1] + 1;
    let room = is_room(pads, point.len());
    require(room, Refused::Bounds("the number of samples"))?;
    let rho = verifier.challenge();
    let factors = verifier.receive_extension(count)?;
    let said = MaskedSums {
        tau,
        masks,
        sums,
        rho,
        factors,
        theta: verifier.challenge(),
    };
    let linear = LinearEquation::new(&equations, &said, pads);
    // A secret value is what it was stated as but for its pad.
    let delta =
        Extension::dot_of_extensions(&linear.coefficients, verifier.padded()) + linear.known;
    let product = verifier.receive_extension(1)?[0];
    work::check_work(verifier, WORK, "the pads")?;
    let [xi, eta] = [0, 1].map(|_| verifier.challenge());
    let claim = there[0] + xi * there[1] + eta * (product + xi * delta);
    let (at, left) = sumcheck::verify(verifier, point.len(), 2, claim)?;
    let value = verifier.receive_extension(1)?[0];
    let expected = (eq(point, &at) + eta * linear.at(&at)) * value;
    weights[first + RANDOM - 1] = xi;
    Ok(End {
        opened: OpenedColumns {
            weights,
            point: at,
            value,
        },
        omega: linear.coefficients,
        delta,
        xi,
        eta,
        left,
        expected,
    })
}

/// The prover's side.
#[cfg(feature = "prove")]
pub mod prove {
    use super::*;
    use crate::commitment::prove::{CommittedSegment, Message};
    use crate::commitment::Parameters;
    use crate::multilinear::evaluate_extension;
    use crate::sumcheck::prove::products;
    use crate::transcript::Prover;

    /// What was committed to, and what is claimed of it.
    pub struct Claimed<'a> {
        /// The dimensions of all segments.
        pub parameters: &'a Parameters,
        /// The segments. The last matrix of the first one has the random columns.
        pub segments: &'a [&'a CommittedSegment],
        /// The number of the first random column.
        pub first: usize,
        /// The point.
        pub point: &'a [Extension],
        /// The sums there. The prover needs their coefficients alone.
        pub sums: &'a [ColumnSum<()>],
    }

    /// States all that is left but the opening. `equations` reads what was stated up to then, as the verifier does. Returns the polynomial to open, and
    /// the point.
    ///
    /// # Errors
    /// There are too few pads, or the words cannot be read.
    pub fn prove(
        prover: &mut Prover,
        claimed: &Claimed<'_>,
        equations: impl FnOnce(&Prover) -> Result<Equations, Refused>,
    ) -> Result<(Message, Vec<Extension>), Refused> {
        let Claimed {
            parameters,
            segments,
            first,
            point,
            sums,
        } = *claimed;
        work::do_work(prover, WORK);
        let mut weights = combination(prover, count(sums));
        let columns = segments.iter().flat_map(|segment| segment.at(point));
        let mut columns: Vec<Extension> = columns.collect();
        let random: Vec<Extension> = columns.drain(first..first + RANDOM).collect();
        let pairs = weights.iter().zip(&columns);
        let sum: Extension = pairs.map(|(&weight, &value)| weight * value).sum();
        prover.send_secret(&[sum, random[0] + X * random[1]]);
        work::do_work(prover, WORK);
        let [chi, psi] = [0, 1].map(|_| prover.challenge());
        add_sums(&mut weights, sums, chi);
        let weights = with_mask(weights, first, psi);
        let mut message = Message::of_columns(parameters, segments, &weights);
        let there = evaluate_extension(&message.values, point);
        prover.send_masked(&[there, random[2]]);

        let equations = equations(prover)?;
        let tau = prover.challenge();
        let factors = equations.factors(prover.secrets());
        let factors = factors.as_flattened();
        let first_mask = prover.secrets().len();
        let masks = prover.masks(factors.len());
        let masks = masks.ok_or(Refused::Bounds("the number of samples"))?;
        let alphas = equations.combined(tau, first_mask).gates;
        let mut with_masks = [Extension::ZERO; 2];
        let pairs = factors.as_chunks().0.iter().zip(masks.as_chunks().0);
        for (&alpha, (&[a, b], &[a_mask, b_mask])) in alphas.iter().zip(pairs) {
            with_masks[0] += alpha * (a * b_mask + a_mask * b);
            with_masks[1] += alpha * a_mask * b_mask;
        }
        prover.send_secret(&with_masks);
        let count = prover.secrets().len();
        let rho = prover.challenge();
        let said = factors.iter().zip(&masks);
        let said: Vec<Extension> = said.map(|(&factor, &mask)| factor + rho * mask).collect();
        prover.send_masked(&said);
        let said = MaskedSums {
            tau,
            masks: first_mask,
            sums: [count - 2, count - 1],
            rho,
            factors: &said,
            theta: prover.challenge(),
        };
        let omega = LinearEquation::new(&equations, &said, count).coefficients;
        let entries = message.values.as_chunks::<2>().0.iter();
        let product: Extension = entries
            .zip(&omega)
            .map(|(&[even, odd], &omega)| omega * (even + X * odd))
            .sum();
        prover.send_masked(&[product]);
        work::do_work(prover, WORK);
        let [xi, eta] = [0, 1].map(|_| prover.challenge());
        message.add_random(segments[0], RANDOM - 1, xi);
        let mut weights = eq_table(point);
        for (entries, &omega) in weights.as_chunks_mut::<2>().0.iter_mut().zip(&omega) {
            entries[0] += eta * omega;
            entries[1] += eta * omega * X;
        }
        let mut left = message.values.clone();
        let at = products(
            prover,
            Prover::send_masked,
            &mut weights,
            &mut left,
            point.len(),
        );
        prover.send_masked(&left);
        Ok((message, at))
    }
}
