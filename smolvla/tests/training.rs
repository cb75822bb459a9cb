//! Preparing samples, training and evaluating at the micro profile.

use candle_core::{Device, Tensor};
use proptest::prelude::*;
use rand::SeedableRng;
use rand_chacha::ChaCha20Rng;
use zk0_smolvla::batch::InMemory;
use zk0_smolvla::evaluate::{evaluate, fixed_draws, FlowDraw};
use zk0_smolvla::frozen::{FrozenPlace, FrozenPrecision};
use zk0_smolvla::init::init_policy;
use zk0_smolvla::model::kernels::gradients::backward;
use zk0_smolvla::model::prefix::PrefixCache;
use zk0_smolvla::optimizer::{AdamW, AdamWOptions};
use zk0_smolvla::sample::{
    CameraImage, FromFrame, Observation, ObservedSample, PreparedSample, Preparer,
};
use zk0_smolvla::schedule::Schedule;
use zk0_smolvla::tokenizer::WordHash;
use zk0_smolvla::train::learner::{Learner, Snapshot, STATE_PROJECTION};
use zk0_smolvla::train::trainer::evaluate_samples;
use zk0_smolvla::train::{train, Samples, TrainOptions, TrainScope, Trainer};
use zk0_smolvla::{ExpertWeights, Policy, PolicyConfig, PolicyError, Profile};

fn config() -> PolicyConfig {
    Profile::Micro.config()
}

fn policy() -> Policy {
    init_policy(&config(), 7).unwrap()
}

/// What a frame is made of, owned, so that a test can spoil a part.
struct Scene {
    pictures: Vec<(&'static str, usize, usize, Vec<u8>)>,
    state: Vec<f32>,
    actions: Vec<f32>,
    is_pad: Vec<bool>,
    task: &'static str,
}

impl Scene {
    /// Frame `k` of a smooth motion: a bright spot and six joints go round together; the last frames' chunks are padded.
    fn at(k: usize) -> Self {
        let phase = k as f32 * 0.2;
        let joint = |i: usize, phase: f32| (phase + i as f32).sin() * 1.4;
        let picture = |height: usize, width: usize, shift: f32| {
            let centre = ((phase + shift).sin() * 0.4 + 0.5) * width as f32;
            let bright = |p: usize| 255.0 / (1.0 + (((p % width) as f32 - centre) / 8.0).powi(2));
            (0..3 * height * width).map(|p| bright(p) as u8).collect()
        };
        Self {
            pictures: vec![
                ("top", 48, 64, picture(48, 64, 0.0)),
                ("wrist", 40, 40, picture(40, 40, 1.0)),
            ],
            state: (0..6).map(|i| joint(i, phase)).collect(),
            actions: (0..6)
                .flat_map(|t| (0..6).map(move |i| joint(i, phase + 0.2 * (t + 1) as f32)))
                .collect(),
            is_pad: (0..6).map(|t| k % 16 + t >= 16).collect(),
            task: if k.is_multiple_of(2) {
                "follow the spot"
            } else {
                "go"
            },
        }
    }

    fn prepare(&self) -> Result<PreparedSample, PolicyError> {
        self.made()
    }

    fn observe(&self) -> Result<ObservedSample, PolicyError> {
        self.made()
    }

    fn made<S: FromFrame>(&self) -> Result<S, PolicyError> {
        self.made_at(&FrozenPlace::default(), &policy())
    }

    fn made_at<S: FromFrame>(
        &self,
        place: &FrozenPlace,
        policy: &Policy,
    ) -> Result<S, PolicyError> {
        let tokenizer = WordHash::new(&config());
        let cameras = self
            .pictures
            .iter()
            .map(|(name, height, width, pixels)| CameraImage {
                name,
                height: *height,
                width: *width,
                pixels,
            });
        let preparer = Preparer::at(place, policy.clone(), &tokenizer)?;
        let observation = Observation {
            cameras: cameras.collect(),
            state: &self.state,
            actions: &self.actions,
            is_pad: &self.is_pad,
            task: self.task,
        };
        S::from_frame(&preparer, &observation)
    }
}

fn samples() -> Vec<PreparedSample> {
    (0..48).map(|k| Scene::at(k).prepare().unwrap()).collect()
}

fn options(seed: u64, steps: usize) -> TrainOptions {
    TrainOptions {
        steps,
        batch_size: 16,
        learning_rate: 3e-3,
        seed,
        ..TrainOptions::default()
    }
}

fn held_out(weights: &ExpertWeights, samples: &[PreparedSample]) -> f64 {
    let mut rng = ChaCha20Rng::seed_from_u64(u64::MAX);
    let draws: Vec<_> = (0..4 * samples.len())
        .map(|_| FlowDraw::random(&config(), &mut rng))
        .collect();
    evaluate(
        &config(),
        weights,
        &samples.iter().cycle().zip(&draws).collect::<Vec<_>>(),
    )
    .unwrap()
    .loss()
}

#[test]
fn a_sample_has_the_profiles_shapes_and_only_real_tokens() {
    let sample = Scene::at(0).prepare().unwrap();
    assert_eq!(sample.prefix_tokens, 2 * 4 + 3 + 1);
    assert_eq!(Scene::at(1).prepare().unwrap().prefix_tokens, 2 * 4 + 1 + 1);
    assert_eq!((sample.keys.len(), sample.values.len()), (2, 2));
    assert!(sample
        .keys
        .iter()
        .chain(&sample.values)
        .all(|layer| layer.len() == 12 * 8));
    assert!(sample
        .actions
        .chunks(8)
        .all(|frame| frame[6..] == [0.0, 0.0] && frame[0] != 0.0));
    let values: Vec<f32> = sample
        .keys
        .iter()
        .chain(&sample.values)
        .flatten()
        .copied()
        .collect();
    let size = (values.iter().map(|x| x * x).sum::<f32>() / values.len() as f32).sqrt();
    assert!(
        (0.2..5.0).contains(&size),
        "keys and values of about unit size, not {size}"
    );
}

#[test]
fn every_part_of_the_observation_reaches_the_cache() {
    let plain = Scene::at(0).prepare().unwrap();
    let changed = |change: fn(&mut Scene)| {
        let mut scene = Scene::at(0);
        change(&mut scene);
        let sample = scene.prepare().unwrap();
        sample.keys[1] != plain.keys[1] && sample.values[1] != plain.values[1]
    };
    assert!(changed(|s| s.pictures[0].3[500] ^= 128));
    assert!(changed(|s| s.pictures[1].3[500] ^= 128));
    assert!(changed(|s| s.state[5] += 0.5));
    assert!(changed(|s| s.task = "follow the light"));
    assert!(
        !changed(|s| s.pictures.reverse()),
        "cameras fill the slots in name order"
    );
    assert!(!changed(|s| s.task = "Follow the spot!"));
}

#[test]
fn observations_that_do_not_fit_are_refused() {
    let refusal = |change: fn(&mut Scene)| {
        let mut scene = Scene::at(0);
        change(&mut scene);
        match scene.prepare() {
            Err(PolicyError::Sample(what)) => what,
            other => panic!("{other:?}"),
        }
    };
    assert!(refusal(|s| s.pictures.clear()).contains("0 cameras"));
    assert!(refusal(|s| s.pictures.push(("extra", 1, 1, vec![0; 3]))).contains("3 cameras"));
    assert!(refusal(|s| s.pictures[1].1 = 41).contains("`wrist`"));
    assert!(refusal(|s| s.pictures[1].1 = usize::MAX).contains("`wrist`"));
    assert!(refusal(|s| (s.pictures[1].1, s.pictures[1].3) = (0, vec![])).contains("`wrist`"));
    assert!(refusal(|s| s.state.push(0.0)).contains("7 dimensions"));
    assert!(refusal(|s| s.state[2] = f32::NAN).contains("state value 2 is NaN"));
    assert!(refusal(|s| s.actions[3] = f32::INFINITY).contains("action value 3 is inf"));
    assert!(refusal(|s| s.actions.truncate(35)).contains("35 action values"));
    assert!(refusal(|s| s.is_pad.push(true)).contains("7 padding flags"));
}

#[test]
fn training_lowers_the_held_out_loss_round_after_round() {
    let samples = samples();
    let mut weights = policy().expert;
    for round in 0..2 {
        let trained = train(
            &config(),
            &weights,
            &samples,
            &options(round, 250),
            &mut |_| (),
        )
        .unwrap();
        let (before, after) = (
            held_out(&weights, &samples),
            held_out(&trained.weights, &samples),
        );
        println!("round {round}: {before:.4} -> {after:.4}");
        assert!(after < 0.8 * before, "round {round}: {before} -> {after}");
        weights = trained.weights;
    }
}

#[test]
fn training_is_a_function_of_its_seed() {
    let (samples, start) = (samples(), policy().expert);
    let run = |seed| train(&config(), &start, &samples, &options(seed, 20), &mut |_| ()).unwrap();
    let (first, again, other) = (run(1), run(1), run(2));
    assert_eq!(
        first.weights.to_safetensors().unwrap(),
        again.weights.to_safetensors().unwrap()
    );
    assert_eq!(first.losses, again.losses);
    assert_ne!(first.weights, other.weights);
}

#[test]
fn every_trainable_tensor_moves() {
    let (samples, start) = (samples(), policy().expert);
    let trained = train(&config(), &start, &samples, &options(1, 2), &mut |_| ()).unwrap();
    for (name, tensor) in start.tensors() {
        assert_ne!(tensor.data, trained.weights.tensors()[name].data, "{name}");
    }
}

#[test]
fn progress_is_reported_step_by_step() {
    let mut seen = Vec::new();
    let trained = train(
        &config(),
        &policy().expert,
        &samples(),
        &options(1, 5),
        &mut |p| seen.push(p),
    )
    .unwrap();
    assert_eq!(
        seen.iter().map(|p| (p.step, p.of)).collect::<Vec<_>>(),
        (1..=5).map(|i| (i, 5)).collect::<Vec<_>>()
    );
    assert_eq!(
        seen.iter().map(|p| p.loss).collect::<Vec<_>>(),
        trained.losses
    );
}

#[test]
fn a_diverging_run_stops_with_an_error() {
    let wild = TrainOptions {
        learning_rate: 1e25,
        schedule: Schedule::Constant,
        ..options(1, 50)
    };
    let error = train(&config(), &policy().expert, &samples(), &wild, &mut |_| ()).unwrap_err();
    assert!(
        matches!(
            error,
            PolicyError::Diverged {
                step: 2..=50,
                of: 50,
                ..
            }
        ),
        "{error}"
    );
}

#[test]
fn bad_options_and_samples_are_refused() {
    let (samples, start) = (samples(), policy().expert);
    let run = |samples: &[PreparedSample], options: TrainOptions| {
        train(&config(), &start, samples, &options, &mut |_| ()).unwrap_err()
    };
    for wrong in [
        options(1, 0),
        TrainOptions {
            batch_size: 0,
            ..options(1, 1)
        },
        TrainOptions {
            batch_size: usize::MAX,
            ..options(1, 1)
        },
        TrainOptions {
            learning_rate: f64::NAN,
            ..options(1, 1)
        },
        TrainOptions {
            learning_rate: -1.0,
            ..options(1, 1)
        },
    ] {
        assert!(matches!(run(&samples, wrong), PolicyError::Options(_)));
    }
    assert!(matches!(run(&[], options(1, 1)), PolicyError::Sample(_)));
    let spoil: [fn(&mut PreparedSample); 6] = [
        |s| s.actions[0] = f32::NAN,
        |s| s.keys[1][0] = f32::INFINITY,
        |s| s.prefix_tokens = 14,
        |s| s.values.truncate(1),
        |s| s.keys[0].truncate(5),
        |s| s.is_pad.truncate(5),
    ];
    for change in spoil {
        let mut spoilt = samples.clone();
        change(&mut spoilt[3]);
        match run(&spoilt, options(1, 1)) {
            PolicyError::Sample(what) => assert!(what.starts_with("sample 3: "), "{what}"),
            other => panic!("{other}"),
        }
    }
    let draw = FlowDraw {
        time: 1.5,
        noise: vec![0.0; 48],
    };
    assert!(matches!(
        evaluate(&config(), &start, &[(&samples[0], &draw)]),
        Err(PolicyError::Sample(_))
    ));
    let draw = FlowDraw {
        time: 0.5,
        noise: vec![0.0; 47],
    };
    assert!(matches!(
        evaluate(&config(), &start, &[(&samples[0], &draw)]),
        Err(PolicyError::Sample(_))
    ));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(8))]
    /// Shorter prefixes are filled up in a batch; that must not change what a sample contributes.
    #[test]
    fn a_sample_counts_the_same_alone_and_in_company(seed: u64) {
        let (start, mut rng) = (policy().expert, ChaCha20Rng::seed_from_u64(seed));
        let pairs: Vec<_> = (10..16).map(|k| (Scene::at(k).prepare().unwrap(), FlowDraw::random(&config(), &mut rng))).collect();
        let pairs: Vec<_> = pairs.iter().map(|(s, d)| (s, d)).collect();
        let together = evaluate(&config(), &start, &pairs).unwrap();
        let alone: Vec<_> = pairs.iter().map(|pair| evaluate(&config(), &start, &[*pair]).unwrap()).collect();
        prop_assert_eq!(together.elements, alone.iter().map(|e| e.elements).sum::<usize>());
        let sum: f64 = alone.iter().map(|e| e.squared_error).sum();
        prop_assert!((together.squared_error / sum - 1.0).abs() < 1e-5);
    }
}

/// Training the state projection too starts from the same numbers as training the expert alone.
#[test]
fn observed_samples_give_the_prefix_of_prepared_ones() {
    let policy = policy();
    let observed: Vec<ObservedSample> = (0..6).map(|k| Scene::at(k).observe().unwrap()).collect();
    let prepared: Vec<PreparedSample> = (0..6).map(|k| Scene::at(k).prepare().unwrap()).collect();
    // Instructions of three words and of one: the batch has padding before the state.
    assert_ne!(
        observed[0].observed.prefix_tokens,
        observed[1].observed.prefix_tokens
    );
    let in_memory = (
        InMemory::new(&config(), &prepared).unwrap(),
        InMemory::observed(&config(), &observed).unwrap(),
    );
    let device = candle_core::Device::Cpu;
    let all: Vec<usize> = (0..6).collect();
    let draws = fixed_draws(&config(), 6, 3);
    let loss = |frozen, samples| {
        let models = Snapshot::new(&config(), &policy.expert, frozen, &device).unwrap();
        evaluate_samples(&models, samples, &all, &draws).unwrap()
    };
    let a = loss(None, Samples::Prepared(&in_memory.0));
    let b = loss(Some(&policy.frozen), Samples::Observed(&in_memory.1));
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

/// How far the last token's keys and values are from those of prepared samples, of all layers the farthest.
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

/// Where the frozen half is rounded, so is what the state's token runs through: training it starts from what the expert alone would
/// be trained on. Not to the bit: products of one row and of many add up in other orders, and a sum may then be rounded to the
/// neighbouring number.
#[test]
fn the_states_token_is_made_in_the_precision_of_the_frozen_half() {
    let policy = policy();
    let all: Vec<usize> = (0..6).collect();
    for precision in PRECISIONS {
        let at = place(precision);
        let prepared = (0..6).map(|k| Scene::at(k).made_at(&at, &policy).unwrap());
        let prepared: Vec<PreparedSample> = prepared.collect();
        let observed = observed_at(&at);
        let observed = InMemory::observed(&config(), &observed).unwrap();
        let samples = Samples::Observed(&observed);
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
                .snapshot()
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
                    "a snapshot is of the same precision"
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

/// A projection that is rounded once, and not at every step, would never be seen to change.
#[test]
fn a_rounded_state_projection_is_the_one_that_is_trained() {
    let (policy, at) = (policy(), place(FrozenPrecision::Bf16));
    let observed = observed_at(&at);
    let observed = InMemory::observed(&config(), &observed).unwrap();
    let (samples, all) = (Samples::Observed(&observed), [0, 1, 2, 3, 4, 5]);
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
    let shown = learner.snapshot().unwrap().batch(samples, &all).unwrap();
    assert_eq!(after, keys(&shown.cache));
}

#[test]
fn the_state_projection_is_trained_when_asked_for() {
    let policy = policy();
    let samples: Vec<ObservedSample> = (0..12).map(|k| Scene::at(k).observe().unwrap()).collect();
    let samples = InMemory::observed(&config(), &samples).unwrap();
    let device = candle_core::Device::Cpu;
    let mut trainer = Trainer::on(
        &device,
        &config(),
        &policy.expert,
        Some(&policy.frozen),
        Samples::Observed(&samples),
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
    let samples = InMemory::new(&config(), &samples).unwrap();
    let device = candle_core::Device::Cpu;
    let (frozen, samples) = (Some(&policy.frozen), Samples::Prepared(&samples));
    let made = Trainer::on(
        &device,
        &config(),
        &policy.expert,
        frozen,
        samples,
        options(1, 1),
    );
    let error = made.unwrap().step().unwrap_err();
    assert!(matches!(error, PolicyError::Sample(_)), "{error}");
}

/// FedProx holds weights near where they start.
#[test]
fn a_proximal_term_keeps_weights_near_their_start() {
    let (samples, start) = (samples(), policy().expert);
    let moved = |fedprox_mu| {
        let options = TrainOptions {
            fedprox_mu,
            ..options(1, 60)
        };
        let mut last = None;
        let trained = train(&config(), &start, &samples, &options, &mut |step| {
            last = Some(step)
        });
        let weights = trained.unwrap().weights;
        let pairs = start.tensors().iter().zip(weights.tensors().values());
        let squares = pairs.flat_map(|((_, a), b)| {
            let pairs = a.data.iter().zip(&b.data);
            pairs
                .map(|(a, b)| f64::from(a - b).powi(2))
                .collect::<Vec<_>>()
        });
        (squares.sum::<f64>().sqrt(), last.unwrap().proximal)
    };
    let ((free, nothing), (held, term)) = (moved(0.0), moved(10.0));
    println!("moved {free:.3} without, {held:.3} with the term");
    assert!(held < 0.5 * free, "{held} {free}");
    assert_eq!(nothing, 0.0);
    assert!(term > 0.0);
}
