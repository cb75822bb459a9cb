//! The node's side of mode `succinct`: it evaluates both models on the opened samples, and makes the argument about the losses.

use super::check::{conclude, context};
use super::input::{ClaimInput, SampleOpening};
use crate::expert::argument::prove::prove;
use crate::expert::witness::{evaluate, Common, Unprovable, Witness};
use crate::prove::progress::Phase;
use std::cell::RefCell;
use std::path::Path;
use zk0_circuits::claim::private_input::PrivateInput;
use zk0_circuits::claim::statement_error::StatementError;
use zk0_circuits::model::draw::draw;

/// Why there is no argument.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum NotMade {
    /// The claim does not hold.
    #[error(transparent)]
    Statement(#[from] StatementError),
    /// The argument cannot express the evaluation.
    #[error("mode succinct cannot prove this evaluation: {0}")]
    Unprovable(Unprovable),
    /// The evaluation is too small.
    #[error(transparent)]
    TooSmall(#[from] super::TooSmall),
}

/// Makes the input of the guest program. An update that does not pass the test is refused before the argument is made. With a folder, what is
/// committed to is in files there that have no names, of half a gigabyte a sample at the published size: then memory does not grow with the number of samples.
///
/// `progress` is told which share of the work is done, from 0 to 1.
pub fn make(
    input: &PrivateInput,
    folder: Option<&Path>,
    progress: &mut dyn FnMut(f64),
) -> Result<ClaimInput<'static>, NotMade> {
    let header = &input.header;
    let progress = RefCell::new(progress);
    let tell = |phase: Phase, share: f64| (progress.borrow_mut())(phase.of_all(share));
    let samples = input
        .openings
        .iter()
        .enumerate()
        .map(|(position, opening)| {
            let count = header.terms.eval_samples;
            let drawn = draw(
                &header.spec,
                &header.terms.challenge,
                position as u32,
                count,
            );
            (opening.sample.clone(), drawn)
        });
    let samples: Vec<_> = samples.collect();
    let models = [&input.base, &input.update];
    let failed = |error| match error {
        Unprovable::Evaluation {
            model,
            sample,
            error,
        } => StatementError::Eval {
            model,
            index: input.openings[sample].index,
            error,
        }
        .into(),
        error => NotMade::Unprovable(error),
    };
    let (statement, kept) =
        evaluate(context(header), &header.spec, models, &samples, &tell).map_err(failed)?;
    conclude(&statement, header, None)?;
    let common = Common::new(&statement, models);
    let witness = |number: usize| {
        let (sample, _) = &samples[number];
        Witness::new(&statement, &common, number, sample, &kept[number])
    };
    let argument = prove(&statement, &common, folder, &tell, witness).map_err(failed)?;
    let argument = argument.ok_or(super::TooSmall)?;
    let openings = input.openings.iter().zip(&statement.samples);
    let openings = openings.map(|(opening, evaluated)| SampleOpening {
        index: opening.index,
        path: opening.path.clone(),
        prefix: evaluated.prefix as u32,
        frames: evaluated.frames as u32,
        losses: evaluated.losses,
    });
    Ok(ClaimInput {
        header: header.clone(),
        openings: openings.collect(),
        argument: argument.into(),
        scales: statement.scales,
    })
}
