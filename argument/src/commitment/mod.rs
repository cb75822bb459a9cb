//! A commitment to multilinear polynomials that are opened together at one point: BaseFold (Zeilberger, Chen and Fisch 2023, eprint
//! 2023/1705) over Reed–Solomon codes.
//!
//! **Commitment.** What is committed to at once is a *segment*: a matrix with a polynomial's values in each column. Each column is taken for
//! the coefficients of a polynomial in one variable, which is evaluated at all powers of a root of unity: that is its codeword. Row `i` of
//! all codewords is leaf `i` of a Merkle tree. All segments have the same height, and each may have another width.
//!
//! **Opening**, at a point that the caller has:
//! 1. The prover says the value of each column there. After a proof of work, a random combination of all columns is opened in their place.
//! 2. The combination's codeword is committed to, and folded with the challenges of a sumcheck, as FRI folds. After every
//!    [`FOLDS`] rounds the codeword that is left is committed to again. The last message is said in full.
//! 3. After a proof of work, positions are drawn. At each of them the rows of all segments are opened, and the folding is followed to the
//!    last message.
//!
//! **Strength.** [`Parameters`] counts queries in the unique decoding regime alone (Ben-Sasson, Carmon, Ishai, Kopparty and Saraf 2020,
//! theorem 1.4): a word that is further than half the distance from all codewords is refused by each query with probability (1 − ρ)/2.

pub mod parameters;
#[cfg(feature = "prove")]
pub mod prove;
mod query;

use crate::field::Extension;
use crate::hash::Digest;
use crate::multilinear::eq_table;
use crate::transcript::{require, work, Challenges, Refused, Verifier};
use crate::tree;
use alloc::vec::Vec;
use parameters::{cap_bits, CAP, FOLDS, WORK};
use query::{Queries, Step};

pub use parameters::{Parameters, Rate};

/// A segment, as the verifier knows it.
#[derive(Clone, Debug)]
pub struct Segment {
    cap: Vec<Digest>,
    width: usize,
}

impl Segment {
    /// The digests of the highest nodes of its tree.
    pub fn cap(&self) -> &[Digest] {
        &self.cap
    }

    /// Reads a commitment to polynomials, `width` of them.
    pub fn receive(verifier: &mut Verifier<'_>, width: usize) -> Result<Self, Refused> {
        let cap = tree::receive_cap(verifier, CAP)?;
        Ok(Self { cap, width })
    }
}

/// What is random about the combination of all columns.
fn combination(challenges: &mut impl Challenges, columns: usize) -> Vec<Extension> {
    let variables = columns.next_power_of_two().ilog2() as usize;
    let mut weights = eq_table(&challenges.challenges(variables));
    weights.truncate(columns);
    weights
}

/// Checks an opening at `point`. Returns the values of all columns there, one segment after the other.
pub fn verify<'a>(
    verifier: &mut Verifier<'a>,
    parameters: &Parameters,
    segments: &[Segment],
    point: &[Extension],
) -> Result<&'a [Extension], Refused> {
    let columns = segments.iter().map(|segment| segment.width).sum();
    let values = verifier.receive_extension(columns)?;
    work::check_work(verifier, WORK, "the combination of columns")?;
    let weights = combination(verifier, columns);
    let mut claim: Extension = weights
        .iter()
        .zip(values)
        .map(|(&weight, &value)| weight * value)
        .sum();

    let mut steps = Vec::with_capacity(parameters.steps());
    let mut coordinates = point.iter();
    let mut length = parameters.length();
    for _ in 0..parameters.steps() {
        length -= FOLDS as u32;
        let cap = tree::receive_cap(verifier, cap_bits(length))?;
        let mut challenges = [Extension::ZERO; FOLDS];
        for (challenge, &coordinate) in challenges.iter_mut().zip(&mut coordinates) {
            // The factor eq is left out of the round polynomial (Gruen 2024, eprint 2024/108). What is left is linear, g, and
            // (1 − coordinate) · g(0) + coordinate · g(1) = claim. Its slope is said.
            let slope = verifier.receive_extension(1)?[0];
            *challenge = verifier.challenge();
            claim += (*challenge - coordinate) * slope;
        }
        steps.push(Step { cap, challenges });
    }
    let rest = coordinates.as_slice();
    let message = verifier.receive_extension(1 << rest.len())?;
    let expected: Extension = eq_table(rest)
        .iter()
        .zip(message)
        .map(|(&weight, &value)| weight * value)
        .sum();
    require(
        expected == claim,
        Refused::Equation("the sumcheck of an opening"),
    )?;

    work::check_work(verifier, WORK, "positions")?;
    let positions = verifier.positions(parameters.rate.queries(), parameters.length());
    let queries = Queries::new(parameters.length(), steps, message);
    for position in positions {
        let mut value = Extension::ZERO;
        let mut weights = &weights[..];
        for segment in segments {
            let row = tree::open(
                verifier,
                &segment.cap,
                parameters.length() - CAP,
                position,
                segment.width,
            )?;
            let (now, later) = weights.split_at(segment.width);
            value += Extension::dot(now, row);
            weights = later;
        }
        queries.check(verifier, position, value)?;
    }
    Ok(values)
}
