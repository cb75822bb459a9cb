//! Training the state projection together with the expert.

use candle_core::{Device, Tensor};
use zk0_smolvla::frames::batch::SamplesInMemory;
use zk0_smolvla::frames::sample::{ObservedSample, PreparedSample};
use zk0_smolvla::measure::evaluate::{evaluate, fixed_draws};
use zk0_smolvla::policy::frozen::{FrozenPlace, FrozenPrecision};
use zk0_smolvla::policy::model::kernels::gradients::backward;
use zk0_smolvla::policy::model::key_values::PrefixCache;
use zk0_smolvla::train::learner::{EvaluationModels, Learner, STATE_PROJECTION};
use zk0_smolvla::train::optimizer::{AdamW, AdamWOptions, Optimizer};
use zk0_smolvla::train::trainer::evaluate_samples;
use zk0_smolvla::train::{TrainScope, Trainer, TrainingSamples};
use zk0_smolvla::PolicyError;

use super::scene::{config, options, policy, samples, Scene};

/// Training the state projection as well starts from the same numbers as training the expert alone.
#[test]
fn observed_samples_give_the_prefix_of_prepared_ones() {
    let policy = policy();
    let observed: Vec<ObservedSample> = (0..6).map(|k| Scene::at(k).observe().unwrap()).collect();
    let prepared: Vec<PreparedSample> = (0..6).map(|k| Scene::at(k).prepare().unwrap()).collect();
    // The instructions have three words or one word, so the batch has padding before the state.
    assert_ne!(
        observed[0].observed.prefix_tokens,
        observed[1].observed.prefix_tokens
    );
    let in_memory = (
        SamplesInMemory::new(&config(), &prepared).unwrap(),
        SamplesInMemory::new(&config(), &observed).unwrap(),
    );
    let cpu = FrozenPlace::default();
    let all: Vec<usize> = (0..6).collect();
    let draws = fixed_draws(&config(), 6, 3);
    let loss = |frozen, samples| {
        let models = EvaluationModels::new(&config(), &policy.expert, frozen, &cpu).unwrap();
        evaluate_samples(&models, samples, &all, &draws).unwrap()
    };
    let a = loss(None, TrainingSamples::Prepared(&in_memory.0));
    let b = loss(
        Some(&policy.frozen),
        TrainingSamples::Observed(&in_memory.1),
    );
    assert_eq!(a.valid_only.elements, b.valid_only.elements);
    assert!((a.valid_only.loss() / b.valid_only.loss() - 1.0).abs() < 1e-5);
    assert!((a.plain.loss() / b.plain.loss() - 1.0).abs() < 1e-5);
    let pairs: Vec<_> = prepared.iter().zip(&draws).collect();
    let plain = evaluate(&config(), &policy.expert, &pairs).unwrap();
    assert!((a.valid_only.loss() / plain.loss() - 1.0).abs() < 1e-6);
}

const PRECISIONS: [FrozenPrecision; 2] = [FrozenPrecision::F32, FrozenPrecision::Bf16];

fn place(precision: FrozenPrecision) -> FrozenPlace {
    FrozenPlace::on(Device::Cpu, Some(precision))
}

fn observed_at(place: &FrozenPlace) -> Vec<ObservedSample> {
    let policy = policy();
    (0..6)
        .map(|k| Scene::at(k).made_at(place, &policy).unwrap())
        .collect()
}

fn numbers(tensor: &Tensor) -> Vec<f32> {
    tensor.flatten_all().unwrap().to_vec1().unwrap()
}

fn relative_distance<'a>(pairs: impl Iterator<Item = (&'a f32, &'a f32)>) -> f64 {
    let (mut apart, mut size) = (0.0, 0.0);
    for (a, b) in pairs {
        apart += f64::from(a - b).powi(2);
        size += f64::from(*b).powi(2);
    }
    (apart / size).sqrt()
}

type Layers = fn(&PreparedSample) -> &Vec<Vec<f32>>;

/// Returns how far the last token's keys and values are from those of prepared samples, in the layer where they are farthest.
fn last_tokens_apart(cache: &PrefixCache, prepared: &[PreparedSample]) -> f64 {
    let width = config().kv_width();
    let mut farthest = 0.0f64;
    for (found, of) in [
        (&cache.keys, (|s| &s.keys) as Layers),
        (&cache.values, (|s| &s.values) as Layers),
    ] {
        for (layer, found) in found.iter().enumerate() {
            let found = numbers(found);
            let last = found.chunks(found.len() / prepared.len());
            let last = last.flat_map(|sample| &sample[sample.len() - width..]);
            let wanted = prepared.iter().map(|sample| &of(sample)[layer]);
            let wanted = wanted.flat_map(|values| &values[values.len() - width..]);
            farthest = farthest.max(relative_distance(last.zip(wanted)));
        }
    }
    farthest
}

/// If the frozen half is rounded, the computation of the state's token is rounded as well. Training then starts from nearly the
/// same numbers as for the expert alone. They are not equal to the bit, because products of one row and of many rows add up in
/// different orders, and a sum may be rounded to the neighbouring number.
#[test]
fn the_states_token_is_made_in_the_precision_of_the_frozen_half() {
    let policy = policy();
    let all: Vec<usize> = (0..6).collect();
    for precision in PRECISIONS {
        let at = place(precision);
        let prepared = (0..6).map(|k| Scene::at(k).made_at(&at, &policy).unwrap());
        let prepared: Vec<PreparedSample> = prepared.collect();
        let observed = observed_at(&at);
        let observed = SamplesInMemory::new(&config(), &observed).unwrap();
        let samples = TrainingSamples::Observed(&observed);
        let apart = |made_in: FrozenPrecision| {
            let (at, frozen) = (place(made_in), Some(&policy.frozen));
            let trainer = Trainer::on(
                &at,
                &config(),
                &policy.expert,
                frozen,
                samples,
                options(1, 4),
            )
            .unwrap();
            let live = Learner::new(&config(), &policy.expert, frozen, &at).unwrap();
            let live = live.batch(samples, &all).unwrap().cache;
            let shown = trainer
                .evaluation_models()
                .unwrap()
                .batch(samples, &all)
                .unwrap()
                .cache;
            for (live, shown) in live
                .keys
                .iter()
                .chain(&live.values)
                .zip(shown.keys.iter().chain(&shown.values))
            {
                assert_eq!(
                    numbers(live),
                    numbers(shown),
                    "the models are of the same precision"
                );
            }
            last_tokens_apart(&shown, &prepared)
        };
        let [of_f32, of_bf16] = PRECISIONS.map(apart);
        println!(
            "{}: f32 {of_f32:.1e}, bf16 {of_bf16:.1e} off",
            precision.name()
        );
        match precision {
            FrozenPrecision::F32 => assert!(of_f32 < 1e-5 && of_bf16 > 1e-3),
            FrozenPrecision::Bf16 => assert!(of_bf16 < 5e-4 && of_f32 > 1e-3),
        }
    }
}

/// The projection is rounded anew at every step. If it were rounded only once, no step would show a change of it.
#[test]
fn a_rounded_state_projection_is_the_one_that_is_trained() {
    let (policy, at) = (policy(), place(FrozenPrecision::Bf16));
    let observed = observed_at(&at);
    let observed = SamplesInMemory::new(&config(), &observed).unwrap();
    let (samples, all) = (TrainingSamples::Observed(&observed), [0, 1, 2, 3, 4, 5]);
    let learner = Learner::new(&config(), &policy.expert, Some(&policy.frozen), &at).unwrap();
    let keys = |cache: &PrefixCache| -> Vec<Vec<f32>> { cache.keys.iter().map(numbers).collect() };

    let before = learner.batch(samples, &all).unwrap();
    let loss = learner
        .loss(&before, &fixed_draws(&config(), 6, 3))
        .unwrap();
    let gradients = backward(&loss).unwrap();
    for name in STATE_PROJECTION {
        let gradient = gradients.get(&learner.variables()[name]).unwrap();
        assert!(numbers(gradient).iter().any(|x| *x != 0.0), "{name}");
    }
    let mut optimizer = AdamW::new(learner.variables(), AdamWOptions::default()).unwrap();
    optimizer.step(&gradients, 0.1).unwrap();

    let after = keys(&learner.batch(samples, &all).unwrap().cache);
    assert_ne!(after, keys(&before.cache));
    let shown = learner
        .evaluation_models()
        .unwrap()
        .batch(samples, &all)
        .unwrap();
    assert_eq!(after, keys(&shown.cache));
}

#[test]
fn the_state_projection_is_trained_when_asked_for() {
    let policy = policy();
    let samples: Vec<ObservedSample> = (0..12).map(|k| Scene::at(k).observe().unwrap()).collect();
    let samples = SamplesInMemory::new(&config(), &samples).unwrap();
    let cpu = FrozenPlace::default();
    let mut trainer = Trainer::on(
        &cpu,
        &config(),
        &policy.expert,
        Some(&policy.frozen),
        TrainingSamples::Observed(&samples),
        options(1, 40),
    )
    .unwrap();
    assert_eq!(trainer.scope(), TrainScope::ExpertAndState);
    let losses: Vec<f32> = (0..40).map(|_| trainer.step().unwrap().loss).collect();
    let values = trainer.values().unwrap();
    for name in ["model.state_proj.weight", "model.state_proj.bias"] {
        assert_ne!(values[name], policy.frozen[name], "{name}");
    }
    assert_eq!(values.len(), policy.expert.tensors().len() + 2);
    assert_eq!(trainer.weights().unwrap().tensors().len() + 2, values.len());
    let mean = |some: &[f32]| some.iter().sum::<f32>() / some.len() as f32;
    assert!(mean(&losses[30..]) < mean(&losses[..10]), "{losses:?}");
}

#[test]
fn samples_of_the_other_scope_are_refused() {
    let policy = policy();
    let samples = samples();
    let samples = SamplesInMemory::new(&config(), &samples).unwrap();
    let cpu = FrozenPlace::default();
    let (frozen, samples) = (Some(&policy.frozen), TrainingSamples::Prepared(&samples));
    let made = Trainer::on(
        &cpu,
        &config(),
        &policy.expert,
        frozen,
        samples,
        options(1, 1),
    );
    let error = made.unwrap().step().unwrap_err();
    assert!(matches!(error, PolicyError::Sample(_)), "{error}");
}
