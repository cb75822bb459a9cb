//! The statement of mode `succinct`: every check between the input and the claim.

use super::input::ClaimInput;
use crate::expert::argument::verify;
use crate::expert::published::Published;
use crate::expert::statement::{EvaluatedSample, Statement};
use crate::operation;
use crate::transcript::Refused;
use alloc::vec::Vec;
use zk0_circuits::claim::dataset::leaf;
use zk0_circuits::claim::private_input::Header;
use zk0_circuits::claim::statement::{self, check_evaluation, check_openings, Opened};
use zk0_circuits::claim::statement_error::StatementError;
use zk0_circuits::claim::t_test::Pair;
use zk0_circuits::model::draw::draw;
use zk0_circuits::vm::digest::tagged_sha256;
use zk0_circuits::{Claim, Digest};

/// Why there is no claim.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum NotShown {
    /// A check that all modes have.
    #[error(transparent)]
    Statement(#[from] StatementError),
    /// The argument does not show the losses.
    #[error("the argument about the losses is refused: {0}")]
    Argument(#[from] Refused),
}

/// The context of an argument ([`Statement::context`]): a hash of the header. The header holds the specification, the digests of both sets of
/// weights, the dataset's root and the challenge, which determines what is drawn.
pub fn context(header: &Header) -> Digest {
    // Writing to memory does not fail.
    let header = borsh::to_vec(header).unwrap_or_default();
    tagged_sha256("zk0/argument/v2", &[&header])
}

/// Checks everything, and returns the claim and what is left to check of the weights, or states which check failed.
///
/// Neither samples nor weights enter the guest. The argument is about samples with certain digests, whose leaves have to be in the dataset. What
/// it leaves to check of the weights is named in [`Claim::weight_check`]. The verifier holds the weights' files and checks it.
pub fn check(input: &ClaimInput<'_>) -> Result<(Claim, Published), NotShown> {
    let header = &input.header;
    check_evaluation(header)?;
    let (claimed, opened) = (header.terms.eval_samples, input.openings.len());
    if claimed as usize != opened {
        return Err(StatementError::Openings { claimed, opened }.into());
    }
    let drawing = operation("noise and times");
    let evaluated = input.openings.iter().enumerate();
    let evaluated = evaluated.map(|(position, opening)| EvaluatedSample {
        prefix: opening.prefix as usize,
        frames: opening.frames as usize,
        draw: draw(
            &header.spec,
            &header.terms.challenge,
            position as u32,
            claimed,
        ),
        losses: opening.losses,
    });
    let statement = Statement {
        context: context(header),
        spec: header.spec.clone(),
        scales: input.scales.clone(),
        saturates: input.saturates,
        samples: evaluated.collect(),
    };
    drawing.end();
    let verified = verify(&statement, &input.argument)?;
    let openings = input.openings.iter().zip(&verified.samples);
    let openings = openings.map(|(opening, sample)| Opened {
        index: opening.index,
        leaf: leaf(&header.salt, &(*sample).into()),
        path: &opening.path,
    });
    check_openings(header, &openings.collect::<Vec<_>>())?;
    let publishing = operation("published claims");
    let left = verified.published.digest(&input.scales);
    publishing.end();
    let claim = conclude(&statement, header, Some(left))?;
    Ok((claim, verified.published))
}

/// The claim that follows from the losses of a statement.
pub(super) fn conclude(
    statement: &Statement,
    header: &Header,
    weight_check: Option<Digest>,
) -> Result<Claim, StatementError> {
    let errors = statement.samples.iter().map(|sample| {
        let [base, update] = sample.losses;
        Pair { base, update }
    });
    let frames: u64 = statement.samples.iter().map(|s| s.frames as u64).sum();
    let evaluated = statement::Evaluated {
        errors: errors.collect(),
        elements: frames * statement.spec.dims.action_dim as u64,
    };
    statement::conclude(header, &evaluated, weight_check)
}
