//! Preparing samples, training and evaluating at the micro profile.

use proptest::prelude::*;
use rand::SeedableRng;
use rand_chacha::ChaCha20Rng;
use zk0_smolvla::frames::sample::PreparedSample;
use zk0_smolvla::measure::evaluate::{evaluate, FlowDraw};
use zk0_smolvla::train::schedule::Schedule;
use zk0_smolvla::train::{train, TrainOptions};
use zk0_smolvla::PolicyError;

use super::scene::{config, held_out, options, policy, samples, Scene};

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
