//! The whole argument about an expert's losses: what both sides do, and the claims about weights and tables that it leaves.
//!
//! The verifier in the guest sees neither weights nor tables. It publishes the claims about them, and whoever has them computes them again
//! ([`Published::check`]).

use super::builder::{DATA, MAIN};
use super::evaluation::layers::Expert;
use super::published::Published;
use super::sample::{height, sample_digest, RATE};
use super::statement::Statement;
use crate::commitment::{self, Parameters, Segment};
use crate::field::Extension;
use crate::hash::Digest;
use crate::multilinear::eq_table;
use crate::operation;
use crate::party::{Claim, Sources};
use crate::protocol::argue;
use crate::relation::{Parts, Source};
use crate::share::share;
use crate::transcript::{require, Refused, Verifier};
use alloc::vec::Vec;

/// How sources become columns: each segment has columns of one height, and a column is what lies in one piece.
pub struct Shape {
    /// Of all segments.
    pub parameters: Parameters,
    /// Columns of a segment of [`MAIN`] and of [`DATA`].
    pub widths: [usize; 2],
    /// Segments of each: one for each sample.
    pub segments: usize,
}

impl Shape {
    /// For an expert.
    pub fn new(expert: &Expert) -> Self {
        let data = expert.source_bits[DATA.0 as usize] as u32;
        // It does not depend on the weights, so that a sample is committed to once, before anybody trains.
        let height = height(data);
        Self {
            parameters: Parameters::new(height, RATE),
            // Columns after the last value are zero, and nobody commits to them.
            widths: [MAIN, DATA].map(|source| expert.used[source.0 as usize].div_ceil(1 << height)),
            segments: expert.builder.relations.count_of_instances(),
        }
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
fn committed(expert: &Expert) -> [(Source, usize); 2] {
    [MAIN, DATA].map(|source| (source, expert.source_bits[source.0 as usize] as usize))
}

/// Checks an argument.
pub fn verify(statement: &Statement, proof: &[u64]) -> Result<Verified, Refused> {
    statement.check_bounds()?;
    let building = operation("relations");
    let expert = Expert::new(statement);
    building.end();
    let shape = Shape::new(&expert);
    let mut verifier = Verifier::new(&statement.digest(), proof);
    let mut segments = Vec::with_capacity(2 * shape.segments);
    for width in shape.widths {
        for _ in 0..shape.segments {
            segments.push(Segment::receive(&mut verifier, width)?);
        }
    }
    // The segments of samples follow those of values.
    let data = statement.samples.iter().zip(&segments[shape.segments..]);
    let samples = data.map(|(s, segment)| sample_digest(s.prefix, s.frames, segment.cap()));
    let samples = samples.collect();
    let mut parts = Parts::default();
    let claims = argue(&mut verifier, &expert.builder.relations, &mut parts)?;
    let sharing = operation("sharing");
    let (own, claims) = split(claims);
    let all = committed(&expert);
    let sources = Sources {
        all: &all,
        instances: expert.builder.relations.bits_of_instances(),
    };
    let (point, values) = share(&mut verifier, &mut parts, &sources, &own)?;
    sharing.end();
    let opening = operation("opening");
    let height = shape.parameters.variables();
    let opened = commitment::verify(
        &mut verifier,
        &shape.parameters,
        &segments,
        &point.own[..height],
    )?;
    let mut columns = opened;
    let weights_of_samples = eq_table(&point.instances);
    for ((width, (_, bits)), value) in shape.widths.into_iter().zip(all).zip(values) {
        let (own, rest) = columns.split_at(width * shape.segments);
        columns = rest;
        let weights = eq_table(&point.own[height..bits]);
        let segments = weights_of_samples.iter().zip(own.chunks_exact(width));
        let of_segment = |own: &[Extension]| -> Extension {
            let columns = weights.iter().zip(own);
            columns.map(|(&w, &v)| w * v).sum()
        };
        let sum: Extension = segments.map(|(&w, own)| w * of_segment(own)).sum();
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
    use crate::expert::blinding::Blind;
    use crate::expert::witness::{Common, Witness};
    use crate::prove::progress::{Phase, Tell};
    use crate::prove::{Instance, Proving, Values};
    use crate::transcript::Prover;
    use std::io;
    use std::path::Path;

    /// The share of the time of committing that goes into computing what is committed to.
    const COMPUTING: f64 = 0.5;

    /// Argues. `witness` gives the values of each sample, one after the other, and no more than one is in memory at a time: with a folder, what is
    /// committed to is in files there, of half a gigabyte a sample at the published size. What is false is argued as if it were true, so that tests can see it refused.
    ///
    /// # Errors
    /// `witness` fails, or a file cannot be written.
    pub fn prove<E: From<io::Error>>(
        statement: &Statement,
        common: &Common,
        _: &Blind,
        folder: Option<&Path>,
        tell: Tell<'_>,
        mut witness: impl FnMut(usize) -> Result<Witness, E>,
    ) -> Result<Vec<u64>, E> {
        let expert = Expert::new(statement);
        let shape = Shape::new(&expert);
        let parameters = &shape.parameters;
        let bits = parameters.variables() as u32;
        let commit = |values: Vec<i64>, width: usize| {
            let columns = Column::cut(&values, 1 << bits, width);
            drop(values);
            let committed = Committed::to(parameters, columns);
            match folder {
                Some(folder) => committed.into_files(folder),
                None => Ok(committed),
            }
        };
        let mut prover = Prover::new(&statement.digest());
        let (mut experts, mut main, mut data) = (vec![], vec![], vec![]);
        for sample in 0..shape.segments {
            let done = |part: f64| {
                let samples = sample as f64 + part;
                tell(Phase::Committing, samples / shape.segments as f64);
            };
            let own = witness(sample)?;
            done(COMPUTING);
            experts.push(own.expert);
            main.push(commit(own.main, shape.widths[0])?);
            data.push(commit(own.data, shape.widths[1])?);
            done(1.0);
        }
        let segments: Vec<&Committed> = main.iter().chain(&data).collect();
        segments.iter().for_each(|segment| segment.say(&mut prover));

        fn of(segments: &[Committed], sample: usize) -> &[Column] {
            segments.get(sample).map_or(&[], Committed::columns)
        }
        let values = |columns| Values::Columns(columns, bits);
        let nothing = Expert::new(&statement.of(None));
        let instances = (0..shape.segments.next_power_of_two()).map(|sample| {
            let expert = experts.get(sample).map_or(&nothing, |expert| &**expert);
            Instance {
                relations: &expert.builder.relations,
                sources: common
                    .sources(values(of(&main, sample)), values(of(&data, sample)))
                    .to_vec(),
            }
        });
        let mut proving =
            Proving::new(prover, instances.collect(), shape.segments, tell).with_files_in(folder);
        let mut parts = Parts::default();
        let relations = &expert.builder.relations;
        if let Ok(claims) = argue(&mut proving, relations, &mut parts) {
            let (claims, _) = split(claims);
            let sources = Sources {
                all: &committed(&expert),
                instances: relations.bits_of_instances(),
            };
            if let Ok((point, _)) = share(&mut proving, &mut parts, &sources, &claims) {
                let point = &point.own[..parameters.variables()];
                open(&mut proving.prover, parameters, &segments, point, tell);
            }
        }
        if let Some(failure) = proving.take_failure() {
            return Err(failure.into());
        }
        Ok(proving.prover.finish())
    }
}
