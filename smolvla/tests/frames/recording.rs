//! Prepares a recording on disk, and trains an expert that learns from it.

use zk0_lerobot::dataset::{Dataset, Normalizer, Stats};
use zk0_smolvla::frames::sample::{PreparedSample, Preparer};
use zk0_smolvla::measure::evaluate::{evaluate, fixed_draws};
use zk0_smolvla::policy::init::init_policy;
use zk0_smolvla::policy::profile::Profile;
use zk0_smolvla::policy::tokenizer::WordHash;
use zk0_smolvla::train::{train, TrainOptions};

use super::setting::recording;
use crate::reference::fixtures;

#[test]
fn a_recording_is_prepared_and_learnt_from() {
    let config = Profile::Micro.config();
    let policy = init_policy(&config, 1).unwrap();
    let tokenizer = WordHash::new(&config);
    let dataset = Dataset::open(recording()).unwrap();
    let mut seen = Vec::new();
    let samples = Preparer::new(&policy, &tokenizer)
        .unwrap()
        .prepare_frames(&dataset, 0..dataset.len(), |done, of| {
            seen.push((done, of));
        })
        .unwrap();
    assert_eq!(samples.len(), 249);
    assert_eq!(seen, (1..=249).map(|i| (i, 249)).collect::<Vec<_>>());

    // The actions are normalised. Over the recording, each dimension has mean 0 and standard deviation 1.
    for dim in 0..6 {
        let values: Vec<f32> = samples.iter().map(|s| s.actions[dim]).collect();
        let mean = values.iter().sum::<f32>() / 249.0;
        let variance = values.iter().map(|x| (x - mean).powi(2)).sum::<f32>() / 249.0;
        assert!(
            mean.abs() < 1e-3 && (variance - 1.0).abs() < 1e-2,
            "{mean} {variance}"
        );
    }
    // Only the last five frames of each of the six episodes have padding.
    let padded = samples.iter().filter(|s| s.is_pad.contains(&true)).count();
    assert_eq!(padded, 6 * 5);

    let options = TrainOptions {
        steps: 300,
        batch_size: 32,
        learning_rate: 3e-3,
        seed: 1,
        ..TrainOptions::default()
    };
    let trained = train(&config, &policy.expert, &samples, &options, &mut |_| ()).unwrap();
    let draws = fixed_draws(&config, 4 * samples.len(), u64::MAX);
    let pairs: Vec<_> = samples.iter().cycle().zip(&draws).collect();
    let loss = |weights| evaluate(&config, weights, &pairs).unwrap().loss();
    let (before, after) = (loss(&policy.expert), loss(&trained.weights));
    println!("{before:.4} -> {after:.4}");
    assert!(after < 0.7 * before, "{before} -> {after}");
}

/// Two recordings for a policy that is trained on both have one normaliser, of all their frames.
#[test]
fn recordings_are_normalised_together() {
    let open = |name: &str| Dataset::open(fixtures().join("datasets").join(name)).unwrap();
    let mut datasets = ["so100_pickplace", "so100_sorting"].map(open);
    let [a, b] = &datasets;
    let own = [(a.stats(), a.len()), (b.stats(), b.len())];
    assert_eq!(Stats::pooled(&own[..1]).unwrap(), *a.stats(), "to the bit");
    let pooled = Stats::pooled(&own).unwrap();
    assert_ne!(pooled, *a.stats());
    assert_eq!(Stats::pooled(&[]), None);
    let five = Normalizer::identity(5).unwrap();
    let other = Stats {
        state: five.clone(),
        action: five,
    };
    assert_eq!(Stats::pooled(&[own[0], (&other, 3)]), None);

    let policy = init_policy(&Profile::Micro.config(), 1).unwrap();
    let tokenizer = WordHash::new(&policy.config);
    let preparer = Preparer::new(&policy, &tokenizer).unwrap();
    let mut actions: Vec<Vec<f32>> = Vec::new();
    for dataset in &mut datasets {
        let reported = dataset
            .normalise_with(other.clone())
            .unwrap_err()
            .to_string();
        assert!(reported.contains("have 5 and 5"), "{reported}");
        dataset.normalise_with(pooled.clone()).unwrap();
        let mut loader = dataset.loader(policy.config.chunk_size).unwrap();
        for frame in 0..dataset.len() {
            let sample: PreparedSample =
                preparer.prepare_frame(dataset, &mut loader, frame).unwrap();
            actions.push(sample.actions[..6].to_vec());
        }
    }
    let frames = actions.len() as f32;
    for dim in 0..6 {
        let mean = actions.iter().map(|a| a[dim]).sum::<f32>() / frames;
        let spread = actions.iter().map(|a| (a[dim] - mean).powi(2));
        let variance = spread.sum::<f32>() / frames;
        assert!(
            mean.abs() < 1e-3 && (variance - 1.0).abs() < 1e-2,
            "{mean} {variance}"
        );
    }
}
