//! The private input of a proof in mode `checked`, where hinted products take the place of the weight matrices.

use crate::claim::private_input::{
    head, read_head, read_samples, samples, Header, InputError, Opening, PrivateInput,
};
use crate::claim::public_values::{GuestWeights, WeightCheck};
use crate::claim::statement_error::StatementError;
use crate::claim::terms::Model;
use crate::freivalds::hints::{coefficients, HintedWeights, Hints};
use crate::freivalds::projection;
use crate::model::draw::draw;
use crate::model::eval::Evaluator;
use crate::model::parameters::Parameters;
use crate::model::weights::QuantisedWeights;
use crate::vm::budget::operation;
use crate::vm::digest::{tagged_sha256, Digest};
use alloc::borrow::Cow;
use alloc::vec;
use alloc::vec::Vec;
use core::convert::Infallible;

/// What [`crate::claim::statement::check_hinted`] needs. As secret as [`PrivateInput`].
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct HintedInput<'a> {
    /// Specification, terms, salt.
    pub header: Header,
    /// The coefficients are expanded from it. It is [`seed`], which depends on all hints.
    pub seed: Digest,
    /// Weights the round started from.
    pub base: HintedWeights<'a>,
    /// Weights contributed.
    pub update: HintedWeights<'a>,
    /// In the order the challenge draws them.
    pub openings: Vec<Opening>,
}

/// Returns the seed of the coefficients (Fiat and Shamir, CRYPTO 1986): a hash of the products and of everything that they
/// depend on.
///
/// Hashed are, in this order: the header, which holds the digests of both weights, the challenge and the dataset's root;
/// both digests of gains and biases; and for each opened sample its leaf, the digest of its hints under the base weights, and
/// that under the update.
pub fn seed(input: &HintedInput<'_>, leaves: &[Digest]) -> Digest {
    let _operation = operation("hashing");
    // Writing to memory does not fail.
    let header = borsh::to_vec(&input.header).unwrap_or_default();
    let (base, update) = (&input.base, &input.update);
    let parameters = [base.parameters.digest(), update.parameters.digest()];
    let mut parts: Vec<&[u8]> = vec![&header];
    parts.extend(parameters.iter().map(|digest| digest.0.as_slice()));
    let hints = base.hints.iter().zip(&update.hints);
    let digests: Vec<[Digest; 2]> = hints
        .map(|(base, update)| [base.digest(), update.digest()])
        .collect();
    for (leaf, hints) in leaves.iter().zip(&digests) {
        parts.push(&leaf.0);
        parts.extend(hints.iter().map(|digest| digest.0.as_slice()));
    }
    tagged_sha256("zk0/weight-check/v1", &parts)
}

impl HintedInput<'static> {
    /// The prover's side: evaluates `input`, keeps all products, draws the coefficients, and computes the projections.
    pub fn of(input: &PrivateInput) -> Result<Self, StatementError> {
        let evaluator = Evaluator::new(&input.header.spec)?;
        let hints = |model, weights: &QuantisedWeights| -> Result<_, StatementError> {
            let parameters = Parameters::of(evaluator.spec, weights);
            let mut hints = Vec::with_capacity(input.openings.len());
            for (position, opening) in input.openings.iter().enumerate() {
                let draw = draw(
                    evaluator.spec,
                    &input.header.terms.challenge,
                    position as u32,
                    input.header.terms.eval_samples,
                );
                let recorded = Hints::record(
                    &evaluator,
                    model,
                    weights,
                    &parameters,
                    &opening.sample,
                    &draw,
                );
                hints.push(recorded.map_err(|error| StatementError::Eval {
                    model,
                    index: opening.index,
                    error,
                })?);
            }
            Ok(HintedWeights {
                parameters,
                projections: Cow::Owned(vec![]),
                hints,
            })
        };
        let mut hinted = Self {
            header: input.header.clone(),
            seed: Digest::default(),
            base: hints(Model::Base, &input.base)?,
            update: hints(Model::Update, &input.update)?,
            openings: input.openings.clone(),
        };
        hinted.seal([&input.base, &input.update])?;
        Ok(hinted)
    }

    /// Draws the seed from the hints as they are, and projects the weights (base, update) with its coefficients.
    pub fn seal(&mut self, weights: [&QuantisedWeights; 2]) -> Result<(), StatementError> {
        let leaves: Vec<Digest> = self
            .openings
            .iter()
            .map(|opening| opening.leaf(&self.header))
            .collect();
        self.project(seed(self, &leaves), weights)
    }

    /// Sets the seed, and projects the weights (base, update) with its coefficients.
    pub fn project(
        &mut self,
        seed: Digest,
        weights: [&QuantisedWeights; 2],
    ) -> Result<(), StatementError> {
        self.seed = seed;
        let evaluator = Evaluator::new(&self.header.spec)?;
        let coefficients = coefficients(&evaluator, &seed);
        let [base, update] = weights.map(|weights| {
            let matrix = |index| Ok::<_, Infallible>(weights.tensor(&evaluator.layout, index));
            let Ok(projections) = projection::project(&evaluator, &coefficients, matrix);
            Cow::Owned(projections.as_flattened().to_vec())
        });
        self.base.projections = base;
        self.update.projections = update;
        Ok(())
    }
}

impl HintedInput<'_> {
    /// Returns what the verifier has to check of the weights.
    pub fn weight_check(&self) -> WeightCheck {
        let _operation = operation("hashing");
        let [base, update] = [&self.base, &self.update].map(|weights| GuestWeights {
            parameters: weights.parameters.digest(),
            projections: projection::digest(weights.projections()),
        });
        WeightCheck {
            seed: self.seed,
            base,
            update,
        }
    }
}

/// Buffers before the hints: header, gains and biases twice, projections twice, samples.
const BUFFERS: usize = 6;

impl<'a> HintedInput<'a> {
    /// Encodes the private input as buffers: header, seed, indices and paths (borsh); gains and biases of base and update;
    /// projections of base and update; samples; and for each opening its hints under the base weights and under the update.
    pub fn to_buffers(&self) -> Vec<Vec<u8>> {
        let mut buffers = vec![head(&self.header, &self.seed, &self.openings)];
        let weights = [&self.base, &self.update];
        buffers.extend(weights.map(|weights| weights.parameters.as_bytes().to_vec()));
        buffers.extend(weights.map(|weights| bytemuck::cast_slice(&weights.projections).to_vec()));
        buffers.push(samples(&self.openings));
        let hints = self.base.hints.iter().zip(&self.update.hints);
        let hints = hints.flat_map(|(base, update)| [base, update]);
        buffers.extend(hints.map(|hints| bytemuck::cast_slice(&hints.0).to_vec()));
        buffers
    }

    /// Returns how many buffers a private input has whose first buffer is `head`.
    pub fn buffers(head: &[u8]) -> Result<usize, InputError> {
        let (_, _, places) = read_head::<Digest>(head)?;
        Ok(BUFFERS + 2 * places.len())
    }

    /// Reads what [`Self::to_buffers`] wrote. It trusts no length in the buffers. Where they are aligned to 8 bytes, it copies
    /// only the samples and small parts.
    pub fn from_buffers<B: AsRef<[u8]>>(buffers: &'a [B]) -> Result<Self, InputError> {
        let wrong = || InputError::Buffers {
            found: buffers.len(),
            expected: BUFFERS,
        };
        let (first, hints) = buffers.split_at_checked(BUFFERS).ok_or_else(wrong)?;
        let [head, base, update, base_projections, update_projections, samples] = first else {
            return Err(wrong());
        };
        let (header, seed, places) = read_head(head.as_ref())?;
        let openings = read_samples(&header.spec, places, samples.as_ref())?;
        if hints.len() != 2 * openings.len() {
            return Err(InputError::Buffers {
                found: buffers.len(),
                expected: BUFFERS + 2 * openings.len(),
            });
        }
        let weights = |which, parameters: &B, projections: &'a B, first: usize| {
            let parameters = Parameters::from_bytes(&header.spec, parameters.as_ref())
                .map_err(|error| InputError::Weights { which, error })?;
            let hints = hints.iter().skip(first).step_by(2);
            let hints = hints.map(|hints| words(hints.as_ref()).map(Hints));
            Ok::<_, InputError>(HintedWeights {
                parameters,
                projections: words(projections.as_ref())?,
                hints: hints.collect::<Result<_, _>>()?,
            })
        };
        Ok(Self {
            base: weights("base", base, base_projections, 0)?,
            update: weights("update", update, update_projections, 1)?,
            header,
            seed,
            openings,
        })
    }
}

/// Returns `bytes` as words, borrowed where they are aligned.
fn words(bytes: &[u8]) -> Result<Cow<'_, [u64]>, InputError> {
    if let Ok(words) = bytemuck::try_cast_slice(bytes) {
        return Ok(Cow::Borrowed(words));
    }
    let (words, rest) = bytes.as_chunks::<8>();
    if !rest.is_empty() {
        return Err(InputError::TrailingBytes(rest.len()));
    }
    Ok(words.iter().map(|word| u64::from_le_bytes(*word)).collect())
}
