//! The node's side of mode `succinct`: it evaluates both models on the opened samples, and makes the argument about the losses.

use super::check::{conclude, context};
use super::committed::of_bytes;
use super::input::{ClaimInput, SampleOpening};
use super::source::ClaimSource;
use crate::expert::argument::prove::prove;
use crate::expert::blinding::Blind;
use crate::expert::prover_values::{evaluate, Common, SampleValues, Samples, Unprovable};
use crate::hash::SpongeDigest;
use crate::prove::progress::Phase;
use std::borrow::Cow;
use std::cell::RefCell;
use std::io;
use std::path::Path;
use zk0_circuits::claim::statement_error::StatementError;
use zk0_circuits::model::draw::{draw, Draw};
use zk0_circuits::Sample;

/// Why there is no argument.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum NotMade {
    /// The claim does not hold.
    #[error(transparent)]
    Statement(#[from] StatementError),
    /// The argument cannot express the evaluation.
    #[error("mode succinct cannot prove this evaluation: {0}")]
    Unprovable(Unprovable),
}

/// The opened samples of a claim, with their draws.
struct ClaimSamples<'a, S: ?Sized> {
    source: &'a S,
    draws: Vec<Draw>,
}

impl<S: ClaimSource + ?Sized> Samples for ClaimSamples<'_, S> {
    fn draws(&self) -> Vec<&Draw> {
        self.draws.iter().collect()
    }

    fn sample(&self, number: usize) -> io::Result<Cow<'_, Sample>> {
        self.source.sample(number)
    }

    fn kept(&self, number: usize) -> io::Result<Option<Vec<SpongeDigest>>> {
        let kept = self.source.kept(number)?;
        Ok((!kept.is_empty()).then(|| of_bytes(&kept)))
    }
}

/// Makes the input of the guest program. An update that does not pass the test is refused before the argument is made. With a folder, what is
/// committed to is in files there that have no names, of half a gigabyte a sample at the published size: then memory hardly grows with the number of samples.
///
/// `blind` is what the samples were committed to with.
///
/// `progress` is told which share of the work is done, from 0 to 1.
pub fn make(
    source: &(impl ClaimSource + ?Sized),
    blind: &Blind,
    folder: Option<&Path>,
    progress: &mut dyn FnMut(f64),
) -> Result<ClaimInput<'static>, NotMade> {
    let header = source.header();
    let progress = RefCell::new(progress);
    let tell = |phase: Phase, share: f64| (progress.borrow_mut())(phase.of_all(share));
    let places = source.places();
    let draws = (0..places.len() as u32).map(|position| {
        let (challenge, count) = (&header.terms.challenge, header.terms.eval_samples);
        draw(&header.spec, challenge, position, count)
    });
    let samples = ClaimSamples {
        source,
        draws: draws.collect(),
    };
    let models = source.models();
    let failed = |error| match error {
        Unprovable::Evaluation {
            model,
            sample,
            error,
        } => StatementError::Eval {
            model,
            index: places[sample].0,
            error,
        }
        .into(),
        error => NotMade::Unprovable(error),
    };
    let statement =
        evaluate(context(header), &header.spec, models, &samples, &tell).map_err(failed)?;
    conclude(&statement, header, None)?;
    let common = Common::new(&statement, models);
    let sample_values = |number| SampleValues::of(&statement, &common, number, models, &samples);
    let argument =
        prove(&statement, &common, blind, folder, &tell, sample_values).map_err(failed)?;
    let openings = places.iter().zip(&statement.samples);
    let openings = openings.map(|((index, path), evaluated)| SampleOpening {
        index: *index,
        path: path.to_vec(),
        prefix: evaluated.prefix as u32,
        frames: evaluated.frames as u32,
        losses: evaluated.losses,
    });
    Ok(ClaimInput {
        header: header.clone(),
        openings: openings.collect(),
        argument: argument.into(),
        scales: statement.scales,
        saturates: statement.saturates,
    })
}
