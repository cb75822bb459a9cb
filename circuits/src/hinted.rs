//! The witness of a claim in mode `checked`: hinted products in place of weight matrices.

use crate::{
    budget::operation,
    challenge::{draw, Draw},
    checked::{rest, Checked},
    coefficients::Coefficients,
    digest::tagged_sha256,
    eval::{EvalError, Evaluator, LossSum},
    field::{Element, Limbs},
    multiply::Recorder,
    parameters::Parameters,
    poseidon2::{hash_words, Domain},
    projection,
    sample::Sample,
    statement::{Model, StatementError},
    witness::{head, read_head, read_samples, samples, Header, Opening, Witness, WitnessError},
    Digest, GuestWeights, QuantisedWeights, WeightCheck,
};
use alloc::{borrow::Cow, vec, vec::Vec};
use core::convert::Infallible;

/// All that [`crate::statement::check_hinted`] needs. Private, like [`Witness`].
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct HintedWitness<'a> {
    /// Claim fields, specification, salt.
    pub header: Header,
    /// What the coefficients are expanded from: [`seed`], which depends on all hints.
    pub seed: Digest,
    /// Weights the round started from.
    pub base: HintedWeights<'a>,
    /// Weights contributed.
    pub update: HintedWeights<'a>,
    /// In the order the challenge draws them.
    pub openings: Vec<Opening>,
}

/// What of a set of weights enters the guest, and what is hinted of its products.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct HintedWeights<'a> {
    /// Gains and biases.
    pub parameters: Parameters,
    /// Projections of the matrices: [`projection::project`].
    pub projections: Cow<'a, [u64]>,
    /// Per opening, the sums of all products.
    pub hints: Vec<Hints<'a>>,
}

/// Hinted sums of one evaluation, in the order of evaluation, zero-padded to 8 bytes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Hints<'a>(Cow<'a, [u64]>);

impl<'a> Hints<'a> {
    /// Copies `sums`.
    pub fn new(sums: &[i32]) -> Self {
        let mut words = vec![0u64; sums.len().div_ceil(2)];
        bytemuck::cast_slice_mut::<u64, i32>(&mut words)[..sums.len()].copy_from_slice(sums);
        Self(Cow::Owned(words))
    }

    /// The sums, perhaps with a zero at the end.
    pub fn sums(&self) -> &[i32] {
        bytemuck::cast_slice(&self.0)
    }

    /// The sums, to be changed.
    pub fn sums_mut(&mut self) -> &mut [i32] {
        bytemuck::cast_slice_mut(self.0.to_mut())
    }

    /// Poseidon2 digest, each sum as two int16.
    pub fn digest(&self) -> Digest {
        hash_words(Domain::Hints, &self.0, 4 * self.0.len() as u64)
    }
}

/// The seed of the coefficients (Fiat and Shamir, CRYPTO 1986): hash of everything the products depend on, and of the
/// products.
///
/// In this order: the header, which holds the digests of both weights, the challenge and the dataset's root; both
/// digests of gains and biases; the leaf of each opened sample; the digests of its hints under the base weights and
/// under the update.
pub fn seed(witness: &HintedWitness<'_>, leaves: &[Digest]) -> Digest {
    let _operation = operation("hashing");
    // Writing to memory does not fail.
    let header = borsh::to_vec(&witness.header).unwrap_or_default();
    let (base, update) = (&witness.base, &witness.update);
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

impl HintedWitness<'static> {
    /// The prover's side: evaluates `witness`, keeps all products, draws the coefficients, computes the projections.
    pub fn of(witness: &Witness) -> Result<Self, StatementError> {
        let evaluator = Evaluator::new(&witness.header.spec)?;
        let hints = |model, weights: &QuantisedWeights| -> Result<_, StatementError> {
            let parameters = Parameters::of(evaluator.spec, weights);
            let mut hints = Vec::with_capacity(witness.openings.len());
            for (position, opening) in witness.openings.iter().enumerate() {
                let draw = draw(evaluator.spec, &witness.header.challenge, position as u32);
                let recorded = record(&evaluator, weights, &parameters, &opening.sample, &draw);
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
            header: witness.header.clone(),
            seed: Digest::default(),
            base: hints(Model::Base, &witness.base)?,
            update: hints(Model::Update, &witness.update)?,
            openings: witness.openings.clone(),
        };
        hinted.seal([&witness.base, &witness.update])?;
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

    /// Takes `seed`, and projects the weights (base, update) with its coefficients.
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

impl HintedWitness<'_> {
    /// What the verifier has to check of the weights.
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

/// The coefficients of a seed, as many as the products take.
pub fn coefficients(evaluator: &Evaluator<'_>, seed: &Digest) -> Coefficients {
    let _operation = operation("coefficients");
    let count = projection::coefficient_count(&evaluator.spec.dims, &evaluator.linears);
    Coefficients::expand(seed, count)
}

fn record(
    evaluator: &Evaluator<'_>,
    weights: &QuantisedWeights,
    parameters: &Parameters,
    sample: &Sample,
    draw: &Draw,
) -> Result<Hints<'static>, EvalError> {
    let mut recorder = Recorder::new(evaluator.direct(weights)?);
    evaluator.loss(parameters, &mut recorder, sample, draw)?;
    Ok(Hints::new(&recorder.hints))
}

impl HintedWeights<'_> {
    /// The projections as field elements.
    pub fn projections(&self) -> &[Limbs] {
        self.projections.as_chunks().0
    }
}

/// Hinted products of one set of weights, ready to be checked.
pub struct Products<'a> {
    evaluator: &'a Evaluator<'a>,
    weights: &'a HintedWeights<'a>,
    coefficients: &'a Coefficients,
    /// Per linear, its projection; `None` if they are too few or too many.
    projections: Option<Vec<&'a [Limbs]>>,
    /// Per linear, what a row of sums holds beside products.
    rests: Vec<Element>,
}

impl<'a> Products<'a> {
    /// Of `weights`, checked with `coefficients`.
    pub fn new(
        evaluator: &'a Evaluator<'a>,
        weights: &'a HintedWeights<'a>,
        coefficients: &'a Coefficients,
    ) -> Self {
        let linears = evaluator.linears.iter();
        Self {
            evaluator,
            weights,
            coefficients,
            projections: projection::by_linear(&evaluator.linears, weights.projections()),
            rests: linears
                .map(|linear| rest(linear, &weights.parameters, coefficients))
                .collect(),
        }
    }

    /// Loss on the sample opened at `position`.
    pub fn loss(
        &self,
        position: usize,
        sample: &Sample,
        draw: &Draw,
    ) -> Result<LossSum, EvalError> {
        let projections = self.projections.as_ref();
        let projections = projections.ok_or(EvalError::Dimensions("the list of projections"))?;
        let hints = self.weights.hints.get(position);
        let hints = hints.ok_or(EvalError::Dimensions("the list of hints"))?;
        let mut checked = Checked::new(hints.sums(), self.coefficients, projections, &self.rests);
        let parameters = &self.weights.parameters;
        let loss = self
            .evaluator
            .loss(parameters, &mut checked, sample, draw)?;
        checked.finish()?;
        Ok(loss)
    }
}

/// Buffers before the hints: header, gains and biases twice, projections twice, samples.
const BUFFERS: usize = 6;

impl<'a> HintedWitness<'a> {
    /// The buffers: header, seed, indices and paths (borsh); gains and biases, base then update; projections, likewise;
    /// samples; per opening its hints under the base weights and under the update.
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

    /// How many buffers a witness has whose first buffer is `head`.
    pub fn buffers(head: &[u8]) -> Result<usize, WitnessError> {
        let (_, _, places) = read_head::<Digest>(head)?;
        Ok(BUFFERS + 2 * places.len())
    }

    /// Reads what [`Self::to_buffers`] wrote; trusts no length in it. Nothing is copied but samples and small parts, where
    /// buffers are aligned to 8 bytes.
    pub fn from_buffers<B: AsRef<[u8]>>(buffers: &'a [B]) -> Result<Self, WitnessError> {
        let wrong = || WitnessError::Buffers {
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
            return Err(WitnessError::Buffers {
                found: buffers.len(),
                expected: BUFFERS + 2 * openings.len(),
            });
        }
        let weights = |which, parameters: &B, projections: &'a B, first: usize| {
            let parameters = Parameters::from_bytes(&header.spec, parameters.as_ref())
                .map_err(|error| WitnessError::Weights { which, error })?;
            let hints = hints.iter().skip(first).step_by(2);
            let hints = hints.map(|hints| words(hints.as_ref()).map(Hints));
            Ok::<_, WitnessError>(HintedWeights {
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

/// `bytes` as words, borrowed where they are aligned.
fn words(bytes: &[u8]) -> Result<Cow<'_, [u64]>, WitnessError> {
    if let Ok(words) = bytemuck::try_cast_slice(bytes) {
        return Ok(Cow::Borrowed(words));
    }
    let (words, rest) = bytes.as_chunks::<8>();
    if !rest.is_empty() {
        return Err(WitnessError::TrailingBytes(rest.len()));
    }
    Ok(words.iter().map(|word| u64::from_le_bytes(*word)).collect())
}
