//! The statement that a proof proves: every check between the private input and the claim.
//!
//! The guest program of mode `direct` runs [`check`]. That of mode `succinct` runs `zk0_argument::claim::check`, of which
//! [`check_evaluation`], [`check_openings`] and [`conclude`] are parts. Where a check fails, these functions
//! return an error, and the guest program panics, so that there is no proof.

use crate::claim::challenge::sample_indices;
use crate::claim::dataset::salt_commitment;
use crate::claim::losses::{Disclosure, Losses};
use crate::claim::private_input::{Header, Opening, PrivateInput};
use crate::claim::public_values::{Claim, CLAIM_VERSION};
use crate::claim::statement_error::StatementError;
use crate::claim::t_test::Pair;
use crate::claim::terms::Model;
use crate::model::draw::{draw, Draw};
use crate::model::eval::{Evaluator, LossSum};
use crate::model::mode::Mode;
use crate::model::sample::Sample;
use crate::model::site::EvalError;
use crate::vm::budget::operation;
use crate::vm::digest::Digest;
use crate::vm::merkle;
use alloc::vec::Vec;

/// Mode `direct`: computes every product. Checks everything and returns the claim, or states which check failed.
///
/// The digests of quantised weights and of the specification are computed here, from what is evaluated. The digests of the
/// weights' files are taken as given: the verifier holds the files and recomputes both kinds.
pub fn check(input: &PrivateInput) -> Result<Claim, StatementError> {
    let header = &input.header;
    let evaluator = evaluator(header)?;
    check_openings(header, &leaves(header, &input.openings))?;
    let weights = [&input.base, &input.update];
    let evaluated = evaluate(header, &input.openings, |model, sample, draw| {
        let mut direct = evaluator.direct(weights[model as usize], model.overflow())?;
        evaluator.loss(&mut direct, sample, draw)
    })?;
    let terms = &header.terms;
    for (model, digest) in [(Model::Base, terms.base), (Model::Update, terms.update)] {
        if weights[model as usize].digest(Mode::Direct) != digest.quantised {
            return Err(StatementError::Weights(model));
        }
    }
    conclude(header, &evaluated, None)
}

/// Prepares the evaluation.
fn evaluator(header: &Header) -> Result<Evaluator<'_>, StatementError> {
    check_evaluation(header)?;
    Ok(Evaluator::new(&header.spec)?)
}

/// Checks that the specification is the one that the terms name, because the round fixes it.
pub fn check_evaluation(header: &Header) -> Result<(), StatementError> {
    let (claimed, given) = (header.terms.evaluation, header.spec.digest());
    if claimed == given {
        Ok(())
    } else {
        Err(StatementError::Evaluation { claimed, given })
    }
}

/// Returns the claim, if the errors pass the test that the terms ask for. `weight_check` is [`Claim::weight_check`].
pub fn conclude(
    header: &Header,
    evaluated: &Evaluated,
    weight_check: Option<Digest>,
) -> Result<Claim, StatementError> {
    let test = header.terms.test;
    let pairs = &evaluated.errors;
    // At most 2^55 per sample and 2^12 samples give 2^67. The disclosed sums saturate. The test does not use them.
    let sum = |of: fn(&Pair) -> u64| pairs.iter().map(of).fold(0, u64::saturating_add);
    let (before, after) = (sum(|pair| pair.base), sum(|pair| pair.update));
    if !test.passes(pairs) {
        return Err(StatementError::NoImprovement {
            before,
            after,
            samples: pairs.len(),
            test,
        });
    }
    Ok(Claim {
        version: CLAIM_VERSION,
        terms: header.terms,
        losses: match header.disclosure {
            Disclosure::Nothing => Losses::Hidden,
            Disclosure::Losses => Losses::Disclosed {
                before,
                after,
                elements: evaluated.elements,
            },
        },
        weight_check,
    })
}

/// An opened sample, as the check of its place in the dataset sees it.
#[derive(Clone, Copy, Debug)]
pub struct Opened<'a> {
    /// Index in the dataset.
    pub index: u64,
    /// Its leaf.
    pub leaf: Digest,
    /// RFC 6962 inclusion path of the leaf.
    pub path: &'a [Digest],
}

/// The openings with their leaves.
fn leaves<'a>(header: &Header, openings: &'a [Opening]) -> Vec<Opened<'a>> {
    let _operation = operation("hashing");
    let opened = openings.iter().map(|opening| Opened {
        index: opening.index,
        leaf: opening.leaf(header),
        path: &opening.path,
    });
    opened.collect()
}

/// Checks that the opened samples are those that the challenge draws from the committed dataset.
pub fn check_openings(header: &Header, openings: &[Opened<'_>]) -> Result<(), StatementError> {
    let _operation = operation("hashing");
    let dataset = &header.terms.dataset;
    let (claimed, opened) = (header.terms.eval_samples, openings.len());
    if claimed as usize != opened {
        return Err(StatementError::Openings { claimed, opened });
    }
    if salt_commitment(&header.salt) != dataset.salt_commitment {
        return Err(StatementError::Salt);
    }
    let drawn = sample_indices(&header.terms.challenge, dataset.samples, claimed)?;
    for (position, (opening, drawn)) in openings.iter().zip(drawn).enumerate() {
        let Opened { index, leaf, path } = opening;
        if *index != drawn {
            return Err(StatementError::Index {
                position,
                found: *index,
                drawn,
            });
        }
        if !merkle::verify(&dataset.root, dataset.samples, drawn, leaf, path) {
            return Err(StatementError::NotCommitted { index: drawn });
        }
    }
    Ok(())
}

/// What was evaluated.
#[derive(Clone, Debug)]
pub struct Evaluated {
    /// One entry for each opening.
    pub errors: Vec<Pair>,
    /// Number of elements that count, over all openings.
    pub elements: u64,
}

/// Evaluates both models on every opening. `loss` returns the loss of a model on a sample.
fn evaluate(
    header: &Header,
    openings: &[Opening],
    loss: impl Fn(Model, &Sample, &Draw) -> Result<LossSum, EvalError>,
) -> Result<Evaluated, StatementError> {
    let terms = &header.terms;
    let mut errors = Vec::with_capacity(openings.len());
    let mut elements = 0;
    for (position, opening) in openings.iter().enumerate() {
        let draw = draw(
            &header.spec,
            &terms.challenge,
            position as u32,
            terms.eval_samples,
        );
        let loss = |model| {
            let loss = loss(model, &opening.sample, &draw);
            loss.map_err(|error| StatementError::Eval {
                model,
                index: opening.index,
                error,
            })
        };
        let (base, update) = (loss(Model::Base)?, loss(Model::Update)?);
        elements += update.elements;
        errors.push(Pair {
            base: base.squared_error,
            update: update.squared_error,
        });
    }
    Ok(Evaluated { errors, elements })
}
