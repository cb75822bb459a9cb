//! The whole argument about an expert's losses: what both sides do, and the claims about weights and tables that it leaves.
//!
//! The verifier in the guest sees neither weights nor tables. It publishes the claims about them, and whoever has them computes them again
//! ([`Published::check`]).

use super::builder::{DATA, MAIN};
use super::evaluation::layers::Expert;
use super::published::Published;
use super::sample::{height, sample_digest, RATE};
use super::sizes::S;
use super::statement::Statement;
use crate::commitment::{self, Parameters, Segment};
use crate::field::Extension;
use crate::hash::Digest;
use crate::multilinear::eq_table;
use crate::operation;
use crate::protocol::{argue, Claim};
use crate::relation::Parts;
use crate::share::share;
use crate::transcript::{require, Refused, Verifier};
use alloc::vec::Vec;

/// How sources become columns: each segment has columns of one height, and a column is what lies in one piece.
pub struct Shape {
    /// Of all segments.
    pub parameters: Parameters,
    /// Columns of a segment of [`MAIN`] and of [`DATA`].
    pub widths: [usize; 2],
    /// Segments of each.
    pub segments: usize,
}

impl Shape {
    /// For an expert. `None` if it is too small for a commitment.
    pub fn new(expert: &Expert) -> Option<Self> {
        let [main, data] = [MAIN, DATA].map(|source| expert.source_bits[source.0 as usize] as u32);
        // It does not depend on the weights, so that a sample is committed to once, before anybody trains.
        let height = height(data);
        (height <= main).then_some(())?;
        Some(Self {
            parameters: Parameters::new(height, RATE)?,
            // Columns after the last value are zero, and nobody commits to them.
            widths: [MAIN, DATA].map(|source| expert.used[source.0 as usize].div_ceil(1 << height)),
            segments: expert.builder.sizes.count(S),
        })
    }
}

/// What a verifier learns.
pub struct Verified {
    /// The digest of each sample. Whoever checks the argument compares it with what the node committed to.
    pub samples: Vec<Digest>,
    /// What is left to check.
    pub published: Published,
}

/// Splits claims into those about what was committed to, and others.
fn split(claims: Vec<Claim>) -> (Vec<Claim>, Vec<Claim>) {
    let committed = |claim: &Claim| [MAIN, DATA].contains(&claim.about.source);
    claims.into_iter().partition(committed)
}

/// Both sources with their variables.
fn sources(expert: &Expert) -> [(crate::relation::Source, usize); 2] {
    let samples = expert.builder.sizes.of(S);
    [MAIN, DATA].map(|source| {
        (
            source,
            (expert.source_bits[source.0 as usize] + samples) as usize,
        )
    })
}

/// Checks an argument.
pub fn verify(statement: &Statement, proof: &[u64]) -> Result<Verified, Refused> {
    statement.check_bounds()?;
    let building = operation("relations");
    let expert = Expert::new(statement);
    building.end();
    let shape = Shape::new(&expert).ok_or(Refused::Equation("the size of a commitment"))?;
    let mut verifier = Verifier::new(&statement.digest(), proof);
    let mut segments = Vec::with_capacity(2 * shape.segments);
    for width in shape.widths {
        for _ in 0..shape.segments {
            segments.push(Segment::receive(&mut verifier, width)?);
        }
    }
    // The segments of samples follow those of values. There may be more than samples.
    let data = statement.samples.iter().zip(&segments[shape.segments..]);
    let samples = data.map(|(s, segment)| sample_digest(s.prefix, s.frames, segment.cap()));
    let samples = samples.collect();
    let mut parts = Parts::default();
    let claims = argue(&mut verifier, &expert.builder.relations, &mut parts)?;
    let sharing = operation("sharing");
    let (committed, claims) = split(claims);
    let sources = sources(&expert);
    let (point, values) = share(&mut verifier, &mut parts, &sources, &committed)?;
    sharing.end();
    let opening = operation("opening");
    let height = shape.parameters.variables();
    let opened = commitment::verify(
        &mut verifier,
        &shape.parameters,
        &segments,
        &point[..height],
    )?;
    let mut columns = opened;
    for ((width, (_, bits)), value) in shape.widths.into_iter().zip(sources).zip(values) {
        let (own, rest) = columns.split_at(width * shape.segments);
        columns = rest;
        let weights = eq_table(&point[height..bits]);
        let each = weights.len() / shape.segments;
        let segments = weights.chunks_exact(each).zip(own.chunks_exact(width));
        let columns = segments.flat_map(|(weights, own)| weights.iter().zip(own));
        let sum: Extension = columns.map(|(&w, &v)| w * v).sum();
        require(
            sum == value,
            Refused::Equation("the columns of a commitment"),
        )?;
    }
    opening.end();
    verifier.finish()?;
    Ok(Verified {
        samples,
        published: Published { parts, claims },
    })
}

/// The prover's side.
#[cfg(feature = "prove")]
pub mod prove {
    use super::*;
    use crate::commitment::prove::columns::Column;
    use crate::commitment::prove::{open, Committed};
    use crate::expert::witness::Witness;
    use crate::field::Goldilocks;
    use crate::prove::Proving;
    use crate::transcript::Prover;
    use rayon::prelude::*;

    /// Argues. What is false is argued as if it were true, so that tests can see it refused.
    pub fn prove(statement: &Statement, expert: &Expert, witness: &Witness) -> Option<Vec<u64>> {
        let shape = Shape::new(expert)?;
        let mut prover = Prover::new(&statement.digest());
        let mut committed = vec![];
        for (values, width) in [&witness.main, &witness.data].into_iter().zip(shape.widths) {
            let height = 1usize << shape.parameters.variables();
            for segment in values.chunks_exact(values.len() / shape.segments) {
                let column = |values: &[i64]| {
                    let elements = values.par_iter().map(|&value| Goldilocks::from_i64(value));
                    Column::from(elements.collect::<Vec<_>>())
                };
                let columns = segment
                    .chunks_exact(height)
                    .take(width)
                    .map(column)
                    .collect();
                committed.push(Committed::of_columns(
                    &mut prover,
                    &shape.parameters,
                    columns,
                ));
            }
        }
        let mut proving = Proving::new(prover, witness.sources().to_vec());
        let mut parts = Parts::default();
        let argued = argue(&mut proving, &expert.builder.relations, &mut parts);
        if let Ok(claims) = argued {
            let (claims, _) = split(claims);
            if let Ok((point, _)) = share(&mut proving, &mut parts, &sources(expert), &claims) {
                let segments: Vec<&Committed> = committed.iter().collect();
                let point = &point[..shape.parameters.variables()];
                open(&mut proving.prover, &shape.parameters, &segments, point);
            }
        }
        Some(proving.prover.finish())
    }
}
