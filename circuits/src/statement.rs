//! The statement a proof proves: from a witness to the claim, every check in between.
//!
//! [`check`] is what the guest program of mode `direct` runs, [`check_hinted`] that of mode `checked`. A failed check is an
//! error here and a panic there, so that no proof exists.

use crate::{
    budget::operation,
    challenge::{draw, sample_indices, Draw, DrawError},
    claim::WeightCheck,
    dataset::salt_commitment,
    eval::{EvalError, Evaluator, LossSum},
    hinted::{coefficients, seed, HintedWitness, Products},
    merkle,
    parameters::Parameters,
    sample::Sample,
    spec::SpecError,
    witness::{Header, Opening, Witness},
    Claim, Digest, Losses, CLAIM_VERSION,
};
use alloc::vec::Vec;
use borsh::{BorshDeserialize, BorshSerialize};

/// What the network's rule lets a claim disclose of the losses.
#[derive(Clone, Copy, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub enum Disclosure {
    /// Nothing but that the improvement holds.
    Hidden,
    /// The sums of squared errors.
    Disclosed,
}

/// How matrix products are proven.
#[derive(Clone, Copy, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub enum Mode {
    /// The guest computes them, from weights that enter it: [`check`].
    Direct,
    /// The guest checks hinted ones, and the verifier projects the weights: [`check_hinted`].
    Checked,
}

impl core::fmt::Display for Mode {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(match self {
            Self::Direct => "direct",
            Self::Checked => "checked",
        })
    }
}

/// Which of the two models.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Model {
    /// The round's base weights.
    Base,
    /// The contributed weights.
    Update,
}

/// Why there is no claim to be proven.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum StatementError {
    /// The specification is refused.
    #[error(transparent)]
    Spec(#[from] SpecError),
    /// The improvement asked for is not a share.
    #[error("a minimum improvement of {0} basis points is above 10000")]
    MinImprovement(u32),
    /// The samples cannot be drawn.
    #[error(transparent)]
    Draw(#[from] DrawError),
    /// Other number of samples than claimed.
    #[error("the claim evaluates {claimed} samples, the witness opens {opened}")]
    Openings {
        /// Samples the claim names.
        claimed: u32,
        /// Samples opened.
        opened: usize,
    },
    /// Not the sample that the challenge draws.
    #[error("opening {position} is of sample {found}, the challenge draws sample {drawn}")]
    Index {
        /// Which opening.
        position: usize,
        /// Index opened.
        found: u64,
        /// Index drawn.
        drawn: u64,
    },
    /// The sample is not in the committed dataset at that index.
    #[error("sample {index} is not the one committed: its path does not lead to the dataset root")]
    NotCommitted {
        /// Index of the sample.
        index: u64,
    },
    /// Not the dataset's salt.
    #[error("the salt is not the one committed with the dataset")]
    Salt,
    /// An evaluation failed.
    #[error("evaluating the {model:?} weights on sample {index}: {error}")]
    Eval {
        /// Which weights.
        model: Model,
        /// Index of the sample.
        index: u64,
        /// Why.
        error: EvalError,
    },
    /// Not the weights that the header names.
    #[error("the {0:?} weights are not those of the header: their digest differs")]
    Weights(Model),
    /// The seed is not that of the hints.
    #[error("the coefficients were drawn from seed {found}, header and hints give {expected}")]
    Seed {
        /// The witness's.
        found: Digest,
        /// What header and hints give.
        expected: Digest,
    },
    /// No element counts: all frames are padding.
    #[error("every frame of the drawn samples is padding: there is no loss")]
    NoElements,
    /// The loss is not lower by the minimum.
    #[error("sum of squared errors went from {before} to {after}: not lower by {min_improvement_bps} basis points")]
    NoImprovement {
        /// Sum under the base weights.
        before: u64,
        /// Sum under the update.
        after: u64,
        /// Least improvement asked for.
        min_improvement_bps: u32,
    },
}

/// Mode `direct`: computes every product. Checks everything and returns the claim, or says which check failed.
///
/// The digests of quantised weights and specification are computed here, from what is evaluated. The blob digests are
/// carried as given: the verifier, who holds the files, recomputes both kinds.
pub fn check(witness: &Witness) -> Result<Claim, StatementError> {
    let header = &witness.header;
    let evaluator = Evaluator::new(&header.spec)?;
    check_openings(header, &witness.openings)?;
    let weights = [&witness.base, &witness.update];
    let parameters = weights.map(|weights| Parameters::of(&header.spec, weights));
    let losses = losses(header, &witness.openings, |model, _, sample, draw| {
        let mut direct = evaluator.direct(weights[model as usize])?;
        evaluator.loss(&parameters[model as usize], &mut direct, sample, draw)
    })?;
    for (model, digest) in [(Model::Base, header.base), (Model::Update, header.update)] {
        if weights[model as usize].digest(Mode::Direct) != digest.quantised {
            return Err(StatementError::Weights(model));
        }
    }
    claim(header, losses, None)
}

/// Mode `checked`: takes every product from hints and checks it with random coefficients. Checks everything and returns the
/// claim, or says which check failed.
///
/// Weight matrices are not here: the claim says with which projections ([`WeightCheck`]) the products hold, and the
/// verifier, who holds the files, recomputes these, and both kinds of weights' digests.
pub fn check_hinted(witness: &HintedWitness<'_>) -> Result<Claim, StatementError> {
    let header = &witness.header;
    let evaluator = Evaluator::new(&header.spec)?;
    let leaves = check_openings(header, &witness.openings)?;
    let expected = seed(witness, &leaves);
    if witness.seed != expected {
        return Err(StatementError::Seed {
            found: witness.seed,
            expected,
        });
    }
    let coefficients = coefficients(&evaluator, &witness.seed);
    let weights = [&witness.base, &witness.update];
    let products = weights.map(|weights| Products::new(&evaluator, weights, &coefficients));
    let losses = losses(
        header,
        &witness.openings,
        |model, position, sample, draw| products[model as usize].loss(position, sample, draw),
    )?;
    claim(header, losses, Some(witness.weight_check()))
}

/// The claim, if the losses improve as the header asks.
fn claim(
    header: &Header,
    (before, after, elements): (u64, u64, u64),
    weight_check: Option<WeightCheck>,
) -> Result<Claim, StatementError> {
    if header.min_improvement_bps > 10_000 {
        return Err(StatementError::MinImprovement(header.min_improvement_bps));
    }
    if !improves(before, after, header.min_improvement_bps) {
        let min_improvement_bps = header.min_improvement_bps;
        return Err(StatementError::NoImprovement {
            before,
            after,
            min_improvement_bps,
        });
    }
    Ok(Claim {
        version: CLAIM_VERSION,
        network: header.network,
        round: header.round,
        node: header.node,
        dataset: header.dataset,
        evaluation: header.spec.digest(),
        base: header.base,
        update: header.update,
        challenge: header.challenge,
        eval_samples: header.eval_samples,
        min_improvement_bps: header.min_improvement_bps,
        losses: match header.disclosure {
            Disclosure::Hidden => Losses::Hidden,
            Disclosure::Disclosed => Losses::Disclosed {
                before,
                after,
                elements,
            },
        },
        weight_check,
    })
}

/// Whether a loss sum of `after` is lower than `before` by at least `min_improvement_bps` basis points; equal is never
/// an improvement.
pub fn improves(before: u64, after: u64, min_improvement_bps: u32) -> bool {
    let kept = 10_000u128.saturating_sub(min_improvement_bps as u128);
    after < before && after as u128 * 10_000 <= before as u128 * kept
}

/// The samples are those the challenge draws, from the committed dataset; returns their leaves.
fn check_openings(header: &Header, openings: &[Opening]) -> Result<Vec<Digest>, StatementError> {
    let _operation = operation("hashing");
    let dataset = &header.dataset;
    let (claimed, opened) = (header.eval_samples, openings.len());
    if claimed as usize != opened {
        return Err(StatementError::Openings { claimed, opened });
    }
    if salt_commitment(&header.salt) != dataset.salt_commitment {
        return Err(StatementError::Salt);
    }
    let drawn = sample_indices(&header.challenge, dataset.samples, claimed)?;
    let mut leaves = Vec::with_capacity(opened);
    for (position, (opening, drawn)) in openings.iter().zip(drawn).enumerate() {
        let found = opening.index;
        if found != drawn {
            return Err(StatementError::Index {
                position,
                found,
                drawn,
            });
        }
        let leaf = opening.leaf(header);
        if !merkle::verify(&dataset.root, dataset.samples, drawn, &leaf, &opening.path) {
            return Err(StatementError::NotCommitted { index: drawn });
        }
        leaves.push(leaf);
    }
    Ok(leaves)
}

/// Sums of squared errors under base and update, and the number of elements. `evaluate` gives the loss of a model on the
/// sample opened at a position.
fn losses(
    header: &Header,
    openings: &[Opening],
    evaluate: impl Fn(Model, usize, &Sample, &Draw) -> Result<LossSum, EvalError>,
) -> Result<(u64, u64, u64), StatementError> {
    let (mut before, mut after, mut elements) = (0, 0, 0);
    for (position, opening) in openings.iter().enumerate() {
        let draw = draw(&header.spec, &header.challenge, position as u32);
        let evaluate = |model| {
            evaluate(model, position, &opening.sample, &draw).map_err(|error| {
                StatementError::Eval {
                    model,
                    index: opening.index,
                    error,
                }
            })
        };
        // At most 2^36 per element, 2^18 elements, 2^12 samples would be 2^66: saturate, which can only refuse.
        let base = evaluate(Model::Base)?;
        before = u64::saturating_add(before, base.squared_error);
        after = u64::saturating_add(after, evaluate(Model::Update)?.squared_error);
        elements += base.elements;
    }
    if elements == 0 {
        return Err(StatementError::NoElements);
    }
    Ok((before, after, elements))
}
