//! A commitment to multilinear polynomials that are opened together at one point: BaseFold (Zeilberger, Chen and Fisch 2023, eprint
//! 2023/1705) over Reed–Solomon codes.
//!
//! **Commitment.** What is committed to at once is a *segment*: matrices with a polynomial's values in each column. Each column is taken for
//! the coefficients of a polynomial in one variable, and random coefficients follow them, its *tail*. It is evaluated at all powers of a root of
//! unity: that is its codeword. Row `i` of all codewords, and a salt, is a leaf of a Merkle tree, whose number is `i` with its bits reversed. All
//! segments have the same height.
//!
//! **Opening** of a combination of all columns, whose weights the caller has, at a point:
//! 1. The combination's codeword is committed to, and folded with the challenges of a sumcheck, as FRI folds. After every
//!    [`FOLDS`] rounds the codeword that is left is committed to again. Tails fold along: one coefficient is left of them. The last message is
//!    stated in full.
//! 2. After a proof of work, positions are drawn. At each of them the rows of all segments are opened, and the folding is followed to the
//!    last message.
//!
//! **Strength.** [`Parameters`] counts queries in the unique decoding regime alone (Ben-Sasson, Carmon, Ishai, Kopparty and Saraf 2020,
//! theorem 1.4): a word that is further than half the distance from all codewords is refused by each query with probability (1 − ρ)/2. A codeword
//! of a column with its tail determines both.
//!
//! **What it shows.** Any rows, as many as a tail has coefficients, are uniform (bounded independence: Ben-Sasson and others 2018, eprint
//! 2018/828; Haböck and Al Kindi 2024, eprint 2024/1037), and salts hide the others from guesses (Ben-Sasson, Chiesa and Spooner 2016, eprint
//! 2016/116). What is folded is the combination itself, so the caller adds a random polynomial to it.

pub mod parameters;
#[cfg(feature = "prove")]
pub mod prove;
mod query;

use crate::field::Extension;
use crate::hash::SpongeDigest;
use crate::multilinear::eq_table;
use crate::transcript::{require, work, Challenges, Refused, Verifier};
use crate::tree;
use alloc::vec::Vec;
use parameters::{cap_bits, CAP, FOLDS, POSITION_WORK, SALT};
use query::{FoldStep, Queries};

pub use parameters::{Parameters, Rate};

/// A segment, as the verifier knows it.
#[derive(Clone, Debug)]
pub struct Segment {
    cap: Vec<SpongeDigest>,
    /// Columns of each matrix.
    widths: Vec<usize>,
}

impl Segment {
    /// The digests of the highest nodes of its tree.
    pub fn cap(&self) -> &[SpongeDigest] {
        &self.cap
    }

    /// Reads a commitment to matrices with so many columns.
    pub fn receive(verifier: &mut Verifier<'_>, widths: Vec<usize>) -> Result<Self, Refused> {
        let cap = tree::receive_cap(verifier, CAP)?;
        Ok(Self { cap, widths })
    }
}

/// Checks that `Σ weights · columns` is `claim` at a point. There is a weight for each column, one segment after the other. Returns the positions
/// that were opened.
pub fn verify(
    verifier: &mut Verifier<'_>,
    parameters: &Parameters,
    segments: &[Segment],
    weights: &[Extension],
    point: &[Extension],
    mut claim: Extension,
) -> Result<Vec<usize>, Refused> {
    let mut steps = Vec::with_capacity(parameters.steps());
    let mut coordinates = point.iter();
    let mut length = parameters.length();
    for _ in 0..parameters.steps() {
        length -= FOLDS as u32;
        let cap = tree::receive_cap(verifier, cap_bits(length))?;
        let mut challenges = [Extension::ZERO; FOLDS];
        for (challenge, &coordinate) in challenges.iter_mut().zip(&mut coordinates) {
            // The factor eq is left out of the round polynomial (Gruen 2024, eprint 2024/108). What is left is linear, g, and
            // (1 − coordinate) · g(0) + coordinate · g(1) = claim. Its slope is stated.
            let slope = verifier.receive_extension(1)?[0];
            *challenge = verifier.challenge();
            claim += (*challenge - coordinate) * slope;
        }
        steps.push(FoldStep { cap, challenges });
    }
    let rest = coordinates.as_slice();
    // What is left of tails follows the values.
    let message = verifier.receive_extension((1 << rest.len()) + 1)?;
    let expected: Extension = eq_table(rest)
        .iter()
        .zip(message)
        .map(|(&weight, &value)| weight * value)
        .sum();
    require(
        expected == claim,
        Refused::Equation("the sumcheck of an opening"),
    )?;

    work::check_work(verifier, POSITION_WORK, "positions")?;
    let positions = verifier.positions(parameters.positions, parameters.length());
    let queries = Queries::new(parameters.length(), steps, message);
    for &position in &positions {
        let leaf = parameters.leaf(position);
        let mut value = Extension::ZERO;
        let mut weights = weights;
        for segment in segments {
            let row = tree::open(
                verifier,
                &segment.cap,
                parameters.length() - CAP,
                leaf,
                &segment.widths,
                SALT,
            )?;
            let (now, later) = weights.split_at(row.len());
            value += Extension::dot(now, row);
            weights = later;
        }
        queries.check(verifier, position, value)?;
    }
    Ok(positions)
}
