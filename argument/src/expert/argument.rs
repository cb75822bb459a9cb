//! The whole argument about an expert's losses: what both sides do, and the claims about weights and tables that it leaves.
//!
//! The verifier in the guest sees neither weights nor tables. It publishes the claims about them, and whoever has them computes them again
//! ([`Published::check`]).

use super::builder::{DATA, MAIN};
use super::evaluation::layers::Expert;
use super::published::Published;
use super::sample::sample_digest;
use super::statement::Statement;
use crate::commitment::{self, Parameters, Segment};
use crate::field::Extension;
use crate::form::Form;
use crate::hash::SpongeDigest;
use crate::multilinear::{eq_table, outer};
use crate::opening::{self, ColumnSum, RANDOM};
use crate::operation;
use crate::party::{Party, Sources, ValueClaim, Weighted};
use crate::protocol::argue;
use crate::relation::{ColumnSource, Part, Parts};
use crate::share::share;
use crate::sumcheck::JoinedPoint;
use crate::transcript::{Refused, Verifier};
use crate::verify::Verifying;
use alloc::vec;
use alloc::vec::Vec;

/// How sources become columns: all columns have one height, and a column is what lies in one piece. One segment has the values of all samples, and
/// the random columns after them; a segment follows for each sample.
pub struct Shape {
    /// Of all segments.
    pub parameters: Parameters,
    /// Columns of a sample in [`MAIN`] and in [`DATA`].
    pub widths: [usize; 2],
    /// How many there are.
    pub samples: usize,
    /// Both sources with their variables.
    pub sources: [(ColumnSource, usize); 2],
}

impl Shape {
    /// For an expert. The height does not depend on the weights, so that a sample is committed to once, before anybody trains.
    pub fn new(expert: &Expert) -> Self {
        let sources = [MAIN, DATA];
        let parameters = Parameters::of_samples(expert.source_bits[DATA.0 as usize].into());
        Self {
            parameters,
            // Columns after the last value are zero, and nobody commits to them.
            widths: sources
                .map(|source| expert.used[source.0 as usize].div_ceil(1 << parameters.variables())),
            samples: expert.builder.relations.count_of_instances(),
            sources: sources.map(|source| (source, expert.source_bits[source.0 as usize].into())),
        }
    }

    /// Columns of the matrices of each segment.
    pub fn segments(&self) -> Vec<Vec<usize>> {
        let [main, data] = self.widths;
        let mut values = vec![main; self.samples];
        values.push(RANDOM);
        let mut segments = vec![values];
        segments.resize(1 + self.samples, vec![data]);
        segments
    }

    /// The number of the first random column.
    pub fn first_random(&self) -> usize {
        self.widths[0] * self.samples
    }

    /// The coefficients by which the values of each source at a point are sums of what columns are at its first coordinates.
    fn coefficients(&self, point: &JoinedPoint) -> [Vec<Extension>; 2] {
        let columns = self.widths.map(|width| width * self.samples);
        let samples = eq_table(&point.instances);
        [0, 1].map(|number| {
            let above = &point.own[self.parameters.variables()..self.sources[number].1];
            let mut own = eq_table(above);
            own.truncate(self.widths[number]);
            let mut all = vec![Extension::ZERO; columns[0] + columns[1]];
            let first = columns[..number].iter().sum::<usize>();
            let own = outer(&own, &samples[..self.samples]);
            all[first..][..columns[number]].copy_from_slice(&own);
            all
        })
    }
}

/// What a verifier learns.
pub struct Verified {
    /// The digest of each sample. Whoever checks the argument compares it with what the node committed to.
    pub samples: Vec<SpongeDigest>,
    /// What is left to check.
    pub published: Published,
}

/// Claims that there is nothing in a sample's columns after its last value, at one random point: otherwise a copy of a sample could have another
/// digest. What is left of columns falls into pieces whose size is a power of two.
fn nothing_behind<P: Party>(
    party: &mut P,
    expert: &Expert,
    shape: &Shape,
    parts: &mut Parts,
) -> Vec<ValueClaim<P::Value>> {
    let point = party.challenges(shape.sources[1].1);
    let instances = party.challenges(expert.builder.relations.bits_of_instances());
    let instances = parts.add(Part::Point(instances));
    let mut first = expert.used[DATA.0 as usize];
    let end = shape.widths[1] << shape.parameters.variables();
    let mut claims = vec![];
    while first < end {
        let bits = first.trailing_zeros().min((end - first).ilog2()) as usize;
        let about = Weighted {
            source: DATA,
            offset: first,
            parts: vec![(0, parts.add(Part::Point(point[..bits].to_vec())))],
            instances: Some(instances),
        };
        let value = party.nothing(&about);
        claims.push(ValueClaim { about, value });
        first += 1 << bits;
    }
    claims
}

/// What was argued up to what is left to show of columns.
#[doc(hidden)]
pub struct LeftColumns<V> {
    /// The point of all columns and instances.
    pub point: JoinedPoint,
    /// The values of both sources there.
    values: Vec<V>,
    published: Published,
}

/// Argues up to what is left to show of columns.
#[doc(hidden)]
pub fn argued<P: Party>(
    party: &mut P,
    expert: &Expert,
    shape: &Shape,
) -> Result<LeftColumns<P::Value>, Refused> {
    let (mut parts, relations) = (Parts::default(), &expert.builder.relations);
    let mut left = argue(party, relations, &mut parts)?;
    let sharing = operation("sharing");
    let nothing = nothing_behind(party, expert, shape, &mut parts);
    left.secret.extend(nothing);
    let sources = Sources {
        all: &shape.sources,
        instances: relations.bits_of_instances(),
    };
    let (point, values) = share(party, &mut parts, &sources, &left.secret)?;
    sharing.end();
    Ok(LeftColumns {
        point,
        values,
        published: Published {
            parts,
            claims: left.published,
        },
    })
}

/// An argument that was read up to what it leaves to show of columns.
pub struct Argued<'a, 'v> {
    /// The verifier, and the equations.
    pub verifying: Verifying<'a, 'v>,
    segments: Vec<Segment>,
    verified: Verified,
    /// Where sums of columns are claimed.
    pub point: Vec<Extension>,
    /// These.
    pub sums: Vec<ColumnSum<Form>>,
}

impl<'a, 'v> Argued<'a, 'v> {
    /// Reads the argument.
    pub fn read(
        verifier: &'a mut Verifier<'v>,
        statement: &Statement,
        expert: &Expert,
        shape: &Shape,
    ) -> Result<Self, Refused> {
        let segments = shape.segments().into_iter();
        let segments = segments.map(|widths| Segment::receive(verifier, widths));
        let segments = segments.collect::<Result<Vec<_>, _>>()?;
        let data = statement.samples.iter().zip(&segments[1..]);
        let samples = data.map(|(s, segment)| sample_digest(s.prefix, s.frames, segment.cap()));
        let samples = samples.collect();
        let mut verifying = Verifying::new(verifier);
        let LeftColumns {
            point,
            values,
            published,
        } = argued(&mut verifying, expert, shape)?;
        let sums = shape.coefficients(&point).into_iter().zip(values);
        let sums = sums.map(|(coefficients, value)| ColumnSum {
            coefficients,
            value,
        });
        Ok(Self {
            verifying,
            segments,
            verified: Verified { samples, published },
            point: point.own[..shape.parameters.variables()].to_vec(),
            sums: sums.collect(),
        })
    }
}

/// Checks an argument.
pub fn verify(statement: &Statement, proof: &[u64]) -> Result<Verified, Refused> {
    let verifier = Verifier::new(&statement.digest(), proof);
    verify_with(statement, verifier).map(|(verified, _)| verified)
}

/// What was drawn in an argument.
#[doc(hidden)]
pub struct DrawnPoints {
    /// Where values of columns are claimed.
    pub point: Vec<Extension>,
    /// The weights of all columns.
    pub weights: Vec<Extension>,
    /// Where they were opened.
    pub positions: Vec<usize>,
}

/// Checks the argument that a verifier reads.
#[doc(hidden)]
pub fn verify_with(
    statement: &Statement,
    mut verifier: Verifier<'_>,
) -> Result<(Verified, DrawnPoints), Refused> {
    statement.check_bounds()?;
    let building = operation("relations");
    let expert = Expert::new(statement);
    building.end();
    let shape = Shape::new(&expert);
    let Argued {
        verifying,
        segments,
        verified,
        point,
        sums,
    } = Argued::read(&mut verifier, statement, &expert, &shape)?;
    let ending = operation("end");
    let opened = opening::verify(verifying, &point, shape.first_random(), &sums)?;
    ending.end();
    let opening = operation("opening");
    let positions = commitment::verify(
        &mut verifier,
        &shape.parameters,
        &segments,
        &opened.weights,
        &opened.point,
        opened.value,
    )?;
    opening.end();
    verifier.finish()?;
    let drawn = DrawnPoints {
        point,
        weights: opened.weights,
        positions,
    };
    Ok((verified, drawn))
}

/// The prover's side.
#[cfg(feature = "prove")]
pub mod prove {
    use super::*;
    use crate::commitment::prove::columns::Column;
    use crate::commitment::prove::{open, CodeMatrix, CommittedSegment, Committing, Hiding};
    use crate::expert::blinding::Blind;
    use crate::expert::prover_values::{Common, SampleValues};
    use crate::expert::sample::prove::commit;
    use crate::opening::prove::Claimed;
    use crate::prove::progress::{Phase, Tell};
    use crate::prove::{Instance, Proving, SourceValues};
    use crate::transcript::{Pads, Prover};
    use std::io;
    use std::path::Path;

    /// The share of the time of committing that goes into computing what is committed to.
    const COMPUTING: f64 = 0.5;

    /// What hides an argument.
    pub struct Hidden<'a> {
        /// All but samples.
        pub argument: Box<dyn Hiding>,
        /// A sample, by the digest of its values.
        pub sample: &'a dyn Fn(usize, &zk0_circuits::Digest) -> Box<dyn Hiding>,
        /// Challenges follow from the statement alone, which tests want.
        pub deaf: bool,
    }

    /// Argues. `sample_values` gives the values of each sample, one after the other, and no more than one is in memory at a time: with a folder, what is
    /// committed to is in files there, of half a gigabyte a sample at the published size. What is false is argued as if it were true, so that tests can see it refused.
    ///
    /// # Errors
    /// `sample_values` fails, a file cannot be written, the system has no random bytes, or there are too many samples.
    pub fn prove<E: From<io::Error>>(
        statement: &Statement,
        common: &Common,
        blind: &Blind,
        folder: Option<&Path>,
        tell: Tell<'_>,
        sample_values: impl FnMut(usize) -> Result<SampleValues, E>,
    ) -> Result<Vec<u64>, E> {
        let hidden = Hidden {
            argument: Box::new(blind.of_argument(&statement.digest())?),
            sample: &|_, values| Box::new(blind.of_sample(values)),
            deaf: false,
        };
        let prover = prove_with(
            statement,
            common,
            hidden,
            folder,
            tell,
            sample_values,
            |proving, expert, shape| argued(proving, expert, shape),
        )?;
        let words = prover.finish();
        Ok(words.map_err(io::Error::other)?)
    }

    /// Whether there is a pad for all that is secret in a statement about other samples than this one's, but as many. The verifier counts while it reads
    /// zeros.
    pub fn has_room(statement: &Statement) -> Result<bool, Refused> {
        /// More than any argument has before its end
        const WORDS: usize = 1 << 21;
        let expert = Expert::new(statement);
        let shape = Shape::new(&expert);
        let words = vec![0; WORDS];
        let mut verifier = Verifier::new(&statement.digest(), &words).deaf();
        let argued = Argued::read(&mut verifier, statement, &expert, &shape)?;
        let first = shape.first_random();
        let equations = opening::equations(argued.verifying, first, &argued.sums)?;
        let end = 2 * equations.count_of_gates() + 2;
        Ok(opening::is_room(
            verifier.padded().len() + end,
            shape.parameters.variables(),
        ))
    }

    /// The first equation that does not hold, of what a prover stated.
    #[doc(hidden)]
    pub fn unmet(statement: &Statement, prover: &Prover) -> Result<Option<&'static str>, Refused> {
        let expert = Expert::new(statement);
        let shape = Shape::new(&expert);
        let mut verifier = prover.verifier(&statement.digest());
        let argued = Argued::read(&mut verifier, statement, &expert, &shape)?;
        let first = shape.first_random();
        let equations = opening::equations(argued.verifying, first, &argued.sums)?;
        Ok(equations.unmet(prover.secrets()))
    }

    /// Argues with what hides the argument, by `argued`, and returns the prover.
    #[doc(hidden)]
    pub fn prove_with<E: From<io::Error>>(
        statement: &Statement,
        common: &Common,
        hidden: Hidden<'_>,
        folder: Option<&Path>,
        tell: Tell<'_>,
        mut sample_values: impl FnMut(usize) -> Result<SampleValues, E>,
        argued: impl FnOnce(
            &mut Proving<'_>,
            &Expert,
            &Shape,
        ) -> Result<LeftColumns<Extension>, Refused>,
    ) -> Result<Prover, E> {
        let expert = Expert::new(statement);
        let shape = Shape::new(&expert);
        let parameters = &shape.parameters;
        let bits = parameters.variables() as u32;
        let hiding = hidden.argument;
        let cut = |values: Vec<i64>, width: usize| Column::cut(&values, 1 << bits, width);
        let (mut experts, mut data) = (vec![], vec![]);
        let first_random = shape.first_random();
        let mut main = Committing::new(parameters, first_random + RANDOM);
        for sample in 0..shape.samples {
            let done = |part: f64| {
                let samples = sample as f64 + part;
                tell(Phase::Committing, samples / shape.samples as f64);
            };
            let own = sample_values(sample)?;
            done(COMPUTING);
            experts.push(own.expert);
            let first = sample * shape.widths[0];
            let tails = first..first + shape.widths[0];
            let tails = tails.map(|column| hiding.elements(column, parameters.positions()));
            main.add(CodeMatrix::new(
                cut(own.main, shape.widths[0]),
                tails.collect(),
            ));
            main.into_files(folder)?;
            let columns = cut(own.data, shape.widths[1]);
            let evaluated = &statement.samples[sample];
            let lengths = (evaluated.prefix, evaluated.frames);
            let hiding = |values: &_| (hidden.sample)(sample, values);
            let committed = commit(parameters, columns, lengths, own.kept, hiding);
            let committed = committed.ok_or_else(|| {
                io::Error::other(format!(
                    "the kept tree of sample {sample} does not have as many digests as this version writes"
                ))
            })?;
            data.push(committed.into_files(folder)?);
            done(1.0);
        }
        let (height, tail) = (1 << bits, parameters.longest_tail());
        let random = first_random..first_random + RANDOM;
        let mut random: Vec<_> = random
            .map(|column| hiding.elements(column, height + tail))
            .collect();
        let tails = random.iter_mut().map(|column| column.split_off(height));
        let tails: Vec<_> = tails.collect();
        let pads = random
            .last()
            .map_or(&[][..], |column| Extension::of_coefficients(column));
        let pads = Pads::new(pads.to_vec());
        let columns = random.into_iter().map(Column::from).collect();
        let main = main.finish(CodeMatrix::new(columns, tails), hiding);
        let segments: Vec<&CommittedSegment> = [&main].into_iter().chain(&data).collect();

        let digest = statement.digest();
        let mut prover = Prover::new(&digest, pads);
        if hidden.deaf {
            prover = prover.deaf();
        }
        segments.iter().for_each(|segment| segment.say(&mut prover));
        fn of_matrix(matrix: Option<&CodeMatrix>) -> &[Column] {
            matrix.map_or(&[], CodeMatrix::columns)
        }
        let values = |columns| SourceValues::Columns(columns, bits);
        let nothing = Expert::new(&statement.of(None));
        let instances = (0..shape.samples.next_power_of_two()).map(|sample| {
            let expert = experts.get(sample).map_or(&nothing, |expert| &**expert);
            let of_samples = &main.matrices()[..shape.samples];
            let data = data.get(sample).and_then(|data| data.matrices().first());
            Instance {
                relations: &expert.builder.relations,
                sources: common
                    .sources(
                        values(of_matrix(of_samples.get(sample))),
                        values(of_matrix(data)),
                    )
                    .to_vec(),
            }
        });
        let mut proving =
            Proving::new(prover, instances.collect(), shape.samples, tell).with_files_in(folder);
        let argued = argued(&mut proving, &expert, &shape);
        let ended = argued.and_then(|LeftColumns { point, .. }| {
            let sums = shape.coefficients(&point).map(|coefficients| ColumnSum {
                coefficients,
                value: (),
            });
            let claimed = Claimed {
                parameters,
                segments: &segments,
                first: first_random,
                point: &point.own[..parameters.variables()],
                sums: &sums,
            };
            opening::prove::prove(&mut proving.prover, &claimed, |prover| {
                let mut verifier = prover.verifier(&digest);
                let argued = Argued::read(&mut verifier, statement, &expert, &shape)?;
                opening::equations(argued.verifying, first_random, &argued.sums)
            })
        });
        if let Some(failure) = proving.take_failure() {
            return Err(failure.into());
        }
        let (message, point) = ended.map_err(io::Error::other)?;
        open(
            &mut proving.prover,
            parameters,
            &segments,
            message,
            &point,
            tell,
        );
        Ok(proving.prover)
    }
}
