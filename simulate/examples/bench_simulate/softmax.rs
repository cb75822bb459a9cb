//! Softmax regression by full-batch gradient descent. The file of a node's data, `node-N.f64`, has a row for each sample: its features, then its
//! class.

use crate::Failure;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha20Rng;
use std::convert::Infallible;
use std::fs;
use std::path::Path;
use zk0_simulate::rounds::{round, Federation};

const FEATURES: usize = 32;
const CLASSES: usize = 10;
const SAMPLES: usize = 200;
const STEPS: usize = 5;
const RATE: f64 = 0.5;

/// A node's samples: features and class.
type Samples = Vec<([f64; FEATURES], usize)>;
/// For each class, a weight for each feature and a bias.
type Weights = Vec<[f64; FEATURES + 1]>;

struct Regression(Vec<Samples>);

impl Federation for Regression {
    type Global = Weights;
    type Update = Weights;
    type Collected = (Weights, usize);
    type Error = Infallible;

    fn train(&self, _: u64, node: usize, global: &Weights) -> Result<Weights, Infallible> {
        let mut weights = global.clone();
        for _ in 0..STEPS {
            step(&mut weights, &self.0[node]);
        }
        Ok(weights)
    }

    fn begin(&self, _: &Weights) -> Self::Collected {
        (start(), 0)
    }

    fn add(
        &self,
        (sum, count): &mut Self::Collected,
        _: usize,
        update: Weights,
    ) -> Result<(), Infallible> {
        let sums = sum.iter_mut().flatten();
        sums.zip(update.iter().flatten())
            .for_each(|(sum, value)| *sum += value);
        *count += 1;
        Ok(())
    }

    fn combine(
        &self,
        _: Weights,
        (mut sum, count): Self::Collected,
    ) -> Result<Weights, Infallible> {
        sum.iter_mut()
            .flatten()
            .for_each(|value| *value /= count as f64);
        Ok(sum)
    }
}

fn start() -> Weights {
    vec![[0.0; FEATURES + 1]; CLASSES]
}

/// A step of gradient descent on the mean cross-entropy.
fn step(weights: &mut Weights, samples: &Samples) {
    let mut gradient = start();
    for (features, class) in samples {
        let logits = weights.iter().map(|row| {
            let products = row
                .iter()
                .zip(features)
                .map(|(weight, feature)| weight * feature);
            row[FEATURES] + products.sum::<f64>()
        });
        let logits: Vec<_> = logits.collect();
        let most = logits.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let powers: Vec<_> = logits.iter().map(|logit| (logit - most).exp()).collect();
        let whole: f64 = powers.iter().sum();
        for (number, (row, power)) in gradient.iter_mut().zip(powers).enumerate() {
            let error = power / whole - f64::from(u8::from(number == *class));
            row.iter_mut()
                .zip(features)
                .for_each(|(sum, feature)| *sum += error * feature);
            row[FEATURES] += error;
        }
    }
    let rate = RATE / samples.len() as f64;
    let pairs = weights.iter_mut().flatten().zip(gradient.iter().flatten());
    pairs.for_each(|(weight, slope)| *weight -= rate * slope);
}

/// Writes the data of `nodes` nodes. Each class has a centre, and each node sees the features moved a little.
pub fn make(folder: &Path, nodes: usize) -> Result<(), Failure> {
    let mut rng = ChaCha20Rng::seed_from_u64(1);
    let mut uniform = || rng.random::<f64>() - 0.5;
    let centres: Vec<[f64; FEATURES]> = (0..CLASSES)
        .map(|_| [(); FEATURES].map(|()| uniform()))
        .collect();
    for node in 0..nodes {
        let moved = 0.3 * uniform();
        let mut bytes = Vec::with_capacity(SAMPLES * (FEATURES + 1) * 8);
        for sample in 0..SAMPLES {
            let class = sample % CLASSES;
            for centre in centres[class] {
                bytes.extend((centre + moved + uniform()).to_le_bytes());
            }
            bytes.extend((class as f64).to_le_bytes());
        }
        fs::write(folder.join(format!("node-{node}.f64")), bytes)?;
    }
    Ok(())
}

fn read(folder: &Path, node: usize) -> Result<Samples, Failure> {
    let bytes = fs::read(folder.join(format!("node-{node}.f64")))?;
    let values: Vec<f64> = bytes
        .chunks_exact(8)
        .map(|value| f64::from_le_bytes(value.try_into().unwrap_or_default()))
        .collect();
    let rows = values.chunks_exact(FEATURES + 1).map(|row| {
        let mut features = [0.0; FEATURES];
        features.copy_from_slice(&row[..FEATURES]);
        (features, row[FEATURES] as usize)
    });
    Ok(rows.collect())
}

pub fn train(folder: &Path, nodes: usize, rounds: u64, threads: usize) -> Result<(), Failure> {
    let data = (0..nodes)
        .map(|node| read(folder, node))
        .collect::<Result<_, _>>()?;
    let (federation, all) = (Regression(data), (0..nodes).collect::<Vec<_>>());
    let mut weights = start();
    for number in 0..rounds {
        weights = round(&federation, number, &all, weights, threads)?;
    }
    let bytes = weights
        .iter()
        .flatten()
        .flat_map(|value| value.to_le_bytes());
    Ok(fs::write(
        folder.join("ours.f64"),
        bytes.collect::<Vec<_>>(),
    )?)
}
