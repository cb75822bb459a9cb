//! How well the micro profile learns: rounds of local training and averaging, without proofs or network.
//!
//! `cargo run --release -p zk0-smolvla --example federate -- ROUNDS STEPS BATCH RATE DATASET…`

use std::error::Error;
use std::time::Instant;

use zk0_lerobot::config::PolicyConfig;
use zk0_lerobot::dataset::Dataset;
use zk0_smolvla::frames::sample::{PreparedSample, Preparer};
use zk0_smolvla::measure::evaluate::{evaluate, fixed_draws};
use zk0_smolvla::policy::init::init_policy;
use zk0_smolvla::policy::profile::Profile;
use zk0_smolvla::policy::tokenizer::WordHash;
use zk0_smolvla::policy::weights::ExpertWeights;
use zk0_smolvla::train::{train, TrainOptions};

/// Held-out draws per sample.
const DRAWS: usize = 8;

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [rounds, steps, batch, rate, datasets @ ..] = arguments.as_slice() else {
        return Err("usage: federate ROUNDS STEPS BATCH RATE DATASET…".into());
    };
    let config = Profile::Micro.config();
    let policy = init_policy(&config, 1)?;
    let tokenizer = WordHash::new(&config);
    let preparer = Preparer::new(&policy, &tokenizer)?;
    let mut nodes = Vec::new();
    for folder in datasets {
        let clock = Instant::now();
        let samples = preparer.prepare_dataset(&Dataset::open(folder)?, |_, _| ())?;
        println!(
            "{folder}: {} samples in {:.1?}",
            samples.len(),
            clock.elapsed()
        );
        nodes.push(samples);
    }
    let mut global = policy.expert;
    for round in 0..rounds.parse()? {
        let mut updates = Vec::new();
        for (node, samples) in nodes.iter().enumerate() {
            let clock = Instant::now();
            let options = TrainOptions {
                steps: steps.parse()?,
                batch_size: batch.parse()?,
                learning_rate: rate.parse()?,
                seed: round * 100 + node as u64,
                ..TrainOptions::default()
            };
            let trained = train(&config, &global, samples, &options, &mut |_| ())?;
            let before = held_out(&config, &global, samples)?;
            let after = held_out(&config, &trained.weights, samples)?;
            let time = clock.elapsed();
            println!(
                "round {round} node {node}: {before:.4} -> {after:.4} ({:+.1} %) in {time:.1?}",
                change(before, after)
            );
            updates.push(trained.weights);
        }
        global = average(&config, &updates)?;
        let losses = nodes
            .iter()
            .map(|samples| held_out(&config, &global, samples))
            .collect::<Result<Vec<_>, _>>()?;
        println!("round {round} average: {losses:.4?}");
    }
    Ok(())
}

fn held_out(
    config: &PolicyConfig,
    weights: &ExpertWeights,
    samples: &[PreparedSample],
) -> Result<f64, Box<dyn Error>> {
    let draws = fixed_draws(config, samples.len() * DRAWS, u64::MAX);
    let pairs: Vec<_> = samples.iter().cycle().zip(&draws).collect();
    Ok(evaluate(config, weights, &pairs)?.loss())
}

fn average(
    config: &PolicyConfig,
    updates: &[ExpertWeights],
) -> Result<ExpertWeights, Box<dyn Error>> {
    let mut mean = updates[0].tensors().clone();
    for (name, tensor) in &mut mean {
        for (i, value) in tensor.data.iter_mut().enumerate() {
            *value = updates
                .iter()
                .map(|u| u.tensors()[name].data[i])
                .sum::<f32>()
                / updates.len() as f32;
        }
    }
    Ok(ExpertWeights::from_tensors(config, mean)?)
}

fn change(before: f64, after: f64) -> f64 {
    100.0 * (after / before - 1.0)
}
