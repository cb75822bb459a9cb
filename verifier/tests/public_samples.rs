//! The file of public samples is read strictly, and the loss on it is the loss of the proofs' evaluation.

use proptest::prelude::*;
use zk0_circuits::model::draw::draw;
use zk0_circuits::model::eval::{evaluate, Evaluator, Overflow};
use zk0_circuits::model::layout::expert_tensors;
use zk0_circuits::model::sample::{SampleError, SampleParts};
use zk0_circuits::model::spec::Dims;
use zk0_circuits::{Digest, EvalSpec, QuantisedWeights, Sample};
use zk0_protocol::entries::round_result::PublicLoss;
use zk0_protocol::rules::closing::public_samples::PublicSamples;
use zk0_verifier::blob_digest;
use zk0_verifier::public_samples::{PublicSampleFile, PublicSamplesError};

const NETWORK: Digest = Digest([7; 32]);

fn number(state: &mut u32) -> f32 {
    *state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
    (*state >> 8) as f32 / (1 << 23) as f32 - 1.0
}

/// A sample with `prefix` tokens; the last `padded` frames are past the end of the episode.
fn sample(spec: &EvalSpec, seed: u32, prefix: usize, padded: usize) -> Sample {
    let (dims, mut state) = (&spec.dims, seed);
    let mut list = |count: usize| -> Vec<f32> { (0..count).map(|_| number(&mut state)).collect() };
    let (chunk, width) = (dims.chunk as usize, dims.max_action_dim as usize);
    let cache: Vec<_> = (0..dims.layers)
        .map(|_| {
            (
                list(prefix * dims.kv_width()),
                list(prefix * dims.kv_width()),
            )
        })
        .collect();
    let cache: Vec<_> = cache.iter().map(|(k, v)| (&k[..], &v[..])).collect();
    let is_pad: Vec<bool> = (0..chunk).map(|frame| frame + padded >= chunk).collect();
    let mut actions = list(chunk * width);
    for (frame, values) in actions.chunks_exact_mut(width).enumerate() {
        let real = if is_pad[frame] {
            0
        } else {
            dims.action_dim as usize
        };
        values[real..].fill(0.0);
    }
    let parts = SampleParts {
        cache: &cache,
        actions: &actions,
        is_pad: &is_pad,
    };
    Sample::quantise(spec, parts).unwrap()
}

fn weights(spec: &EvalSpec, seed: u32, scale: f32) -> QuantisedWeights {
    let mut state = seed;
    let tensors: std::collections::BTreeMap<String, Vec<f32>> = expert_tensors(&spec.dims)
        .into_iter()
        .map(|tensor| {
            let values = (0..tensor.len()).map(|_| scale * number(&mut state));
            (tensor.name.clone(), values.collect())
        })
        .collect();
    QuantisedWeights::quantise(spec, |name| tensors.get(name).map(Vec::as_slice)).unwrap()
}

fn file(samples: &[Sample]) -> Vec<u8> {
    samples.iter().flat_map(Sample::as_bytes).copied().collect()
}

fn rule(file: &[u8], samples: u32) -> PublicSamples {
    PublicSamples {
        blob: blob_digest(file),
        samples,
        max_loss_increase_bps: 500,
    }
}

#[test]
fn the_loss_is_the_sum_of_the_evaluations_losses() {
    let spec = EvalSpec::micro();
    let samples = [sample(&spec, 1, 3, 0), sample(&spec, 2, 5, 1)];
    let (bytes, weights) = (file(&samples), weights(&spec, 3, 0.3));
    let rule = rule(&bytes, 2);
    let read = PublicSampleFile::read(&spec, rule, &bytes).unwrap();
    let seed = rule.seed(&NETWORK);
    let losses: Vec<_> = (0..)
        .zip(&samples)
        .map(|(at, sample)| {
            evaluate(
                &spec,
                &weights,
                sample,
                &draw(&spec, &seed, at, 2),
                Overflow::Refused,
            )
            .unwrap()
        })
        .collect();
    let evaluator = Evaluator::new(&spec).unwrap();
    let loss = |network| read.loss(&evaluator, &weights, network).unwrap();
    let sum = losses.iter().map(|loss| loss.squared_error).sum();
    assert_eq!(loss(&NETWORK), PublicLoss::SquaredError(sum));
    let elements: u64 = losses.iter().map(|loss| loss.elements).sum();
    assert_eq!(read.elements(), elements);
    // Noise and times are drawn from the network and the file, and from nothing else.
    assert_eq!(loss(&NETWORK), loss(&NETWORK));
    assert_ne!(loss(&NETWORK), loss(&Digest([8; 32])));
}

#[test]
fn an_overflow_names_the_sample() {
    let spec = EvalSpec::micro();
    let bytes = file(&[sample(&spec, 1, 3, 0)]);
    let read = PublicSampleFile::read(&spec, rule(&bytes, 1), &bytes).unwrap();
    let evaluator = Evaluator::new(&spec).unwrap();
    let loud = weights(&spec, 3, 100.0);
    assert_eq!(
        read.loss(&evaluator, &loud, &NETWORK).unwrap(),
        PublicLoss::Overflow { sample: 0 }
    );
}

#[test]
fn a_file_that_is_not_the_networks_is_refused() {
    let spec = EvalSpec::micro();
    let samples = [sample(&spec, 1, 3, 0), sample(&spec, 2, 5, 1)];
    let bytes = file(&samples);
    let refused = |bytes: &[u8], rule| PublicSampleFile::read(&spec, rule, bytes).unwrap_err();

    // It has another digest.
    let mut other = bytes.clone();
    other[40] ^= 1;
    let (expected, actual) = (blob_digest(&bytes), blob_digest(&other));
    assert_eq!(
        refused(&other, rule(&bytes, 2)),
        PublicSamplesError::OtherFile { expected, actual }
    );
    // It holds another number of samples than the rules count.
    let (found, expected) = (2, 3);
    assert_eq!(
        refused(&bytes, rule(&bytes, 3)),
        PublicSamplesError::TooFew { found, expected }
    );
    let rest = samples[1].as_bytes().len();
    assert_eq!(
        refused(&bytes, rule(&bytes, 1)),
        PublicSamplesError::TooMany {
            bytes: rest,
            expected: 1
        }
    );
    // It ends in the middle of a sample.
    let cut = &bytes[..bytes.len() - 8];
    assert!(matches!(
        refused(cut, rule(cut, 2)),
        PublicSamplesError::Sample {
            number: 1,
            error: SampleError::Length { .. }
        }
    ));
    // Its samples are of other dimensions.
    let tiny = EvalSpec::new(Dims {
        max_prefix: 2,
        ..spec.dims
    });
    assert!(matches!(
        PublicSampleFile::read(&tiny, rule(&bytes, 2), &bytes),
        Err(PublicSamplesError::Sample {
            number: 0,
            error: SampleError::Prefix { found: 3, most: 2 }
        })
    ));
    assert!(matches!(
        refused(&[], rule(&[], 1)),
        PublicSamplesError::TooFew { found: 0, .. }
    ));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// The samples are a stranger's bytes: whoever proposes them chooses their digest, too.
    #[test]
    fn no_file_of_samples_makes_the_evaluation_panic(
        changes in proptest::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 0..200),
        cut in any::<prop::sample::Index>(),
        whole in any::<bool>(),
        count in 1..4u32,
    ) {
        let spec = EvalSpec::micro();
        let mut bytes = file(&[sample(&spec, 1, 3, 0), sample(&spec, 2, 5, 1)]);
        for (at, value) in changes {
            let at = at.index(bytes.len());
            bytes[at] = value;
        }
        if !whole {
            bytes.truncate(cut.index(bytes.len()));
        }
        if let Ok(read) = PublicSampleFile::read(&spec, rule(&bytes, count), &bytes) {
            let evaluator = Evaluator::new(&spec).unwrap();
            let loss = read.loss(&evaluator, &weights(&spec, 3, 0.3), &NETWORK);
            prop_assert!(loss.is_ok(), "{:?}", loss);
        }
    }
}
