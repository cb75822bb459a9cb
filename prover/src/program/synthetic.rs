//! Private inputs from a seed, to count cycles, compare guest and host, and test a machine's prover.
//!
//! Weights and samples are random numbers of a trained model's magnitudes. The base's velocities are doubled and the update's quartered, so
//! that the update has the lower loss. The seed alone decides the result.

use super::elf::elf;
use super::execute::{ExecuteError, Execution, Executor};
use super::guest_input::{GuestInput, PreparedClaim};
use borsh::to_vec;
use std::borrow::Cow;
use std::io;
use zk0_argument::claim::{committed, Blind, ClaimSource, SampleCommitment};
use zk0_circuits::claim::challenge::sample_indices;
use zk0_circuits::claim::dataset::{leaf, salt_commitment};
use zk0_circuits::claim::private_input::{Header, Opening};
use zk0_circuits::claim::statement::check;
use zk0_circuits::claim::statement_error::StatementError;
use zk0_circuits::claim::student::Confidence;
use zk0_circuits::claim::t_test::TTest;
use zk0_circuits::model::layout::expert_tensors;
use zk0_circuits::model::sample::SampleParts;
use zk0_circuits::model::spec::Dims;
use zk0_circuits::vm::digest::tagged_sha256;
use zk0_circuits::vm::merkle;
use zk0_circuits::{
    DatasetCommitment, Digest, Disclosure, EvalSpec, Mode, NodeId, PrivateInput, QuantisedWeights,
    Sample, Terms, WeightsDigest,
};

/// Most draws of weights. With two samples, about a third pass the test.
const TRIES: usize = 64;

const LOUDNESS: [f32; 2] = [2.0, 0.25];

const SEED: u64 = 1;

const HEADER_WORDS: u64 = 5;

/// A private input whose statement holds in `mode`, over `samples` samples of a dataset three times as large.
///
/// # Errors
/// `spec` is unusable, random values do not fit its scales, or `samples` is 0 or 1: no test passes on so few.
pub fn private_input(
    spec: &EvalSpec,
    mode: Mode,
    samples: u32,
    seed: u64,
) -> Result<PrivateInput, String> {
    let (mut input, dataset) = improving(spec, samples, seed)?;
    commit(&mut input, mode, &dataset, &blind(seed));
    Ok(input)
}

/// The blind of [`private_input`]'s samples.
pub fn blind(seed: u64) -> Blind {
    Blind::new(tagged_sha256("zk0/synthetic-blind", &[&seed.to_le_bytes()]).0)
}

/// A private input that makes samples on each read, to save memory.
pub struct MadeAgain {
    header: Header,
    models: [QuantisedWeights; 2],
    places: Vec<(u64, Vec<Digest>)>,
    kept: Vec<Vec<u8>>,
    seed: u64,
}

impl MadeAgain {
    /// The input of [`private_input`].
    pub fn new(spec: &EvalSpec, mode: Mode, samples: u32, seed: u64) -> Result<Self, String> {
        let (mut input, dataset) = improving(spec, samples, seed)?;
        let kept = commit(&mut input, mode, &dataset, &blind(seed));
        let openings = input.openings.into_iter();
        Ok(Self {
            header: input.header,
            models: [input.base, input.update],
            places: openings.map(|of| (of.index, of.path)).collect(),
            kept,
            seed,
        })
    }
}

impl ClaimSource for MadeAgain {
    fn header(&self) -> &Header {
        &self.header
    }

    fn models(&self) -> [&QuantisedWeights; 2] {
        self.models.each_ref()
    }

    fn places(&self) -> Vec<(u64, &[Digest])> {
        let places = self.places.iter();
        places.map(|(index, path)| (*index, &path[..])).collect()
    }

    fn sample(&self, position: usize) -> io::Result<Cow<'_, Sample>> {
        let (index, _) = self.places.get(position).ok_or(io::ErrorKind::NotFound)?;
        let mut random = SplitMix64(self.seed);
        random.skip(index * sample_words(&self.header.spec.dims));
        let sample = sample(&self.header.spec, &mut random, *index as u32);
        sample.map(Cow::Owned).map_err(io::Error::other)
    }

    fn kept(&self, position: usize) -> io::Result<Vec<u8>> {
        let kept = self.kept.get(position).cloned();
        kept.ok_or_else(|| io::ErrorKind::NotFound.into())
    }
}

/// Names weights and samples as nodes in `mode` do. Returns what is kept of the opened samples' commitments.
fn commit(input: &mut PrivateInput, mode: Mode, dataset: &[Sample], blind: &Blind) -> Vec<Vec<u8>> {
    let header = &mut input.header;
    let committed = dataset
        .iter()
        .map(|sample| committed(mode, &header.spec, sample, blind));
    let (leaves, kept): (Vec<Digest>, Vec<Vec<u8>>) = committed
        .map(|SampleCommitment { digest, kept }| (leaf(&header.salt, &digest), kept))
        .unzip();
    header.terms.dataset.root = merkle::root(&leaves);
    for opening in &mut input.openings {
        opening.path = merkle::path(&leaves, opening.index as usize).unwrap_or_default();
    }
    header.terms.base.quantised = input.base.digest(mode);
    header.terms.update.quantised = input.update.digest(mode);
    let opened = input.openings.iter();
    opened
        .map(|opening| kept[opening.index as usize].clone())
        .collect()
}

/// A private input in mode `direct` whose statement holds, and its dataset.
fn improving(
    spec: &EvalSpec,
    samples: u32,
    seed: u64,
) -> Result<(PrivateInput, Vec<Sample>), String> {
    spec.validate().map_err(|error| error.to_string())?;
    let mut random = SplitMix64(seed);
    let dataset: Vec<Sample> = (0..3 * samples)
        .map(|index| sample(spec, &mut random, index))
        .collect::<Result<_, _>>()?;
    let base = weights(spec, &mut random, LOUDNESS[0])?;
    let update = weights(spec, &mut random, LOUDNESS[1])?;

    let salt = random.digest().0;
    let leaves: Vec<Digest> = dataset
        .iter()
        .map(|sample| leaf(&salt, &sample.digest()))
        .collect();
    let header = Header {
        spec: spec.clone(),
        terms: Terms {
            network: random.digest(),
            round: seed,
            node: NodeId(random.digest().0),
            dataset: DatasetCommitment {
                root: merkle::root(&leaves),
                samples: leaves.len() as u64,
                feature_spec: random.digest(),
                salt_commitment: salt_commitment(&salt),
            },
            evaluation: spec.digest(),
            base: WeightsDigest::default(),
            update: WeightsDigest::default(),
            challenge: random.digest(),
            eval_samples: samples,
            test: TTest {
                min_improvement_bps: 0,
                confidence: Confidence::P95,
            },
        },
        disclosure: Disclosure::Losses,
        salt,
    };
    let openings = sample_indices(&header.terms.challenge, leaves.len() as u64, samples)
        .map_err(|error| error.to_string())?
        .into_iter()
        .map(|index| Opening {
            index,
            sample: dataset[index as usize].clone(),
            path: merkle::path(&leaves, index as usize).unwrap_or_default(),
        })
        .collect();
    let mut input = PrivateInput {
        header,
        base,
        update,
        openings,
    };
    let mut checked = Ok(());
    for _ in 0..TRIES {
        name_weights(&mut input, [random.digest(), random.digest()]);
        checked = match check(&input) {
            Ok(_) => return Ok((input, dataset)),
            Err(error @ StatementError::NoImprovement { .. }) => Err(error.to_string()),
            Err(error) => return Err(error.to_string()),
        };
        input.base = weights(spec, &mut random, LOUDNESS[0])?;
        input.update = weights(spec, &mut random, LOUDNESS[1])?;
    }
    checked.map(|()| (input, dataset))
}

/// The dimensions of this name.
///
/// # Errors
/// The name is unknown.
pub fn dims(name: &str) -> Result<Dims, String> {
    match name {
        "micro" => Ok(Dims::MICRO),
        "full" => Ok(Dims::FULL),
        other => Err(format!("there is no model '{other}': write micro or full")),
    }
}

/// Makes a claim over `samples` samples, and executes its program. At full size a sample takes a minute and half a gigabyte.
///
/// # Errors
/// There is no such claim, or SP1 fails.
pub async fn execute(
    executor: &Executor,
    spec: &EvalSpec,
    mode: Mode,
    samples: u32,
) -> Result<(GuestInput, Execution), ExecuteError> {
    let private = private_input(spec, mode, samples, SEED).map_err(ExecuteError::Failed)?;
    let folder = std::env::temp_dir();
    let prepared = PreparedClaim::of(mode, &private, &blind(SEED), Some(&folder), &mut |_| {});
    let input = prepared
        .map_err(|error| ExecuteError::Failed(error.to_string()))?
        .input;
    drop(private);
    let run = executor.execute(elf(mode), &input.buffers).await?;
    Ok((input, run))
}

/// The pairs of weights (base, update) that [`private_input`] tries with the same arguments, until one passes. Makes no samples, so this
/// takes seconds at the published size.
pub fn weights_tried(
    spec: &EvalSpec,
    samples: u32,
    seed: u64,
) -> impl Iterator<Item = Result<[QuantisedWeights; 2], String>> + '_ {
    let mut random = SplitMix64(seed);
    random.skip(3 * u64::from(samples) * sample_words(&spec.dims));
    (0..TRIES).map(move |tries| {
        if tries > 0 {
            // Between tries, the files are named. The header follows the first weights.
            random.skip(if tries == 1 { HEADER_WORDS + 2 } else { 2 });
        }
        let base = weights(spec, &mut random, LOUDNESS[0])?;
        let update = weights(spec, &mut random, LOUDNESS[1])?;
        Ok([base, update])
    })
}

fn name_weights(input: &mut PrivateInput, blobs: [Digest; 2]) {
    let [base, update] = [&input.base, &input.update].map(|weights| weights.digest(Mode::Direct));
    let name = |blob, quantised| WeightsDigest { blob, quantised };
    input.header.terms.base = name(blobs[0], base);
    input.header.terms.update = name(blobs[1], update);
}

/// Random weights: gains around one, small biases, linear layers of unit gain, and velocities `loudness` times as large.
fn weights(
    spec: &EvalSpec,
    random: &mut SplitMix64,
    loudness: f32,
) -> Result<QuantisedWeights, String> {
    let tensors: Vec<(String, Vec<f32>)> = expert_tensors(&spec.dims)
        .into_iter()
        .map(|tensor| {
            let is_gain = tensor.name.contains("norm");
            let factor = if tensor.name.starts_with("model.action_out_proj") {
                loudness
            } else {
                1.0
            };
            let values = (0..tensor.len())
                .map(|_| match tensor.shape.as_slice() {
                    [_] if is_gain => 1.0 + 0.2 * random.symmetric(),
                    [_] => 0.1 * random.symmetric(),
                    shape => random.symmetric() * (3.0 / shape[shape.len() - 1] as f32).sqrt(),
                })
                .map(|value| factor * value)
                .collect();
            (tensor.name, values)
        })
        .collect();
    let find = |name: &str| tensors.iter().find(|(tensor, _)| tensor == name);
    QuantisedWeights::quantise(spec, |name| find(name).map(|(_, values)| values.as_slice()))
        .map_err(|error| error.to_string())
}

/// A random sample with the longest prefix. Its last `index mod 3` frames are padding.
fn sample(spec: &EvalSpec, random: &mut SplitMix64, index: u32) -> Result<Sample, String> {
    let dims = &spec.dims;
    let mut vector = |len: usize| -> Vec<f32> { (0..len).map(|_| random.symmetric()).collect() };
    let prefix = dims.max_prefix as usize * dims.kv_width();
    let cache: Vec<(Vec<f32>, Vec<f32>)> = (0..dims.layers)
        .map(|_| (vector(prefix), vector(prefix)))
        .collect();
    let cache: Vec<(&[f32], &[f32])> = cache.iter().map(|(k, v)| (&k[..], &v[..])).collect();
    let (chunk, width) = (dims.chunk as usize, dims.max_action_dim as usize);
    let mut actions = vector(chunk * width);
    for frame in actions.chunks_mut(width) {
        frame[dims.action_dim as usize..].fill(0.0);
    }
    let real = chunk - (index as usize % 3).min(chunk - 1);
    let is_pad: Vec<bool> = (0..chunk).map(|frame| frame >= real).collect();
    let parts = SampleParts {
        cache: &cache,
        actions: &actions,
        is_pad: &is_pad,
    };
    Sample::quantise(spec, parts).map_err(|error| error.to_string())
}

fn sample_words(dims: &Dims) -> u64 {
    let [layers, prefix, chunk, width] = [
        dims.layers,
        dims.max_prefix,
        dims.chunk,
        dims.max_action_dim,
    ]
    .map(u64::from);
    2 * layers * prefix * dims.kv_width() as u64 + chunk * width
}

/// SplitMix64 (Steele, Lea and Flood 2014).
struct SplitMix64(u64);

const STEP: u64 = 0x9e37_79b9_7f4a_7c15;

impl SplitMix64 {
    fn skip(&mut self, words: u64) {
        self.0 = self.0.wrapping_add(STEP.wrapping_mul(words));
    }

    fn word(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(STEP);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// Uniform in -1 to 1, 24 bits: exact in f32.
    fn symmetric(&mut self) -> f32 {
        (self.word() >> 40) as f32 / (1 << 23) as f32 - 1.0
    }

    fn digest(&mut self) -> Digest {
        tagged_sha256(
            "zk0/synthetic",
            &[&to_vec(&self.word()).unwrap_or_default()],
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn samples_that_are_made_again_are_the_same() {
        let input = private_input(&EvalSpec::micro(), Mode::Direct, 3, 5).unwrap();
        let again = MadeAgain::new(&EvalSpec::micro(), Mode::Direct, 3, 5).unwrap();
        assert_eq!(*again.whole().unwrap(), input);
    }

    #[test]
    fn the_weights_of_an_input_are_among_those_tried() {
        let spec = EvalSpec::micro();
        // These seeds differ in their numbers of tries.
        let tries = [1, 2, 3, 4, 5, 6].map(|seed| {
            let input = private_input(&spec, Mode::Direct, 2, seed).unwrap();
            let mut tried = weights_tried(&spec, 2, seed).map(Result::unwrap);
            let found =
                tried.position(|[base, update]| base == input.base && update == input.update);
            found.expect("the weights of the input")
        });
        assert!(
            tries.contains(&0) && tries.iter().any(|&tries| tries > 1),
            "{tries:?}"
        );
    }
}
