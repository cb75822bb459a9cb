//! From a recording on disk to an expert that has learnt from it.

use std::path::PathBuf;

use zk0_smolvla::dataset::Dataset;
use zk0_smolvla::evaluate::{evaluate, fixed_draws};
use zk0_smolvla::init::init_policy;
use zk0_smolvla::sample::Preparer;
use zk0_smolvla::tokenizer::WordHash;
use zk0_smolvla::train::{train, TrainOptions};
use zk0_smolvla::Profile;

#[test]
fn a_recording_is_prepared_and_learnt_from() {
    let config = Profile::Micro.config();
    let policy = init_policy(&config, 1).unwrap();
    let tokenizer = WordHash::new(&config);
    let folder =
        PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../tests/fixtures/datasets/so100_sorting");
    let dataset = Dataset::open(folder).unwrap();
    let mut seen = Vec::new();
    let samples = Preparer::new(&policy, &tokenizer)
        .unwrap()
        .prepare_dataset(&dataset, |done, of| seen.push((done, of)))
        .unwrap();
    assert_eq!(samples.len(), 249);
    assert_eq!(seen, (1..=249).map(|i| (i, 249)).collect::<Vec<_>>());

    // Normalised: over the recording each action dimension has mean 0 and standard deviation 1.
    for dim in 0..6 {
        let values: Vec<f32> = samples.iter().map(|s| s.actions[dim]).collect();
        let mean = values.iter().sum::<f32>() / 249.0;
        let variance = values.iter().map(|x| (x - mean).powi(2)).sum::<f32>() / 249.0;
        assert!(
            mean.abs() < 1e-3 && (variance - 1.0).abs() < 1e-2,
            "{mean} {variance}"
        );
    }
    // Only the last frames of the six episodes have padding, five of them each.
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
