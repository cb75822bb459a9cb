//! The updates whose chances are measured.

use crate::trials::Result;
use crate::Prepared;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use zk0_smolvla::frames::sample::PreparedSample;
use zk0_smolvla::train::{train, TrainOptions};
use zk0_smolvla::{ExpertWeights, PolicyConfig};

/// Updates of one origin.
pub struct Update {
    pub origin: String,
    /// Some that differ only in chance. Each trial takes the next.
    pub weights: Vec<ExpertWeights>,
    /// Whether the update is terrible on a rare band of samples ([`crate::trials::BAND`]).
    pub banded: bool,
}

/// How the names of updates begin that are noise.
pub const NOISE: &str = "weight noise";
/// The update that is terrible on a rare band of samples.
pub const BANDED: &str = "300 steps, terrible on a rare band";
/// Standard deviations of weight noise, relative to the root mean square of a tensor. Updates with noise of 1 overflow: no proof of them is
/// possible.
const NOISES: [f32; 7] = [0.0005, 0.002, 0.01, 0.03, 0.1, 0.3, 0.6];
/// Updates of one origin that differ only in chance.
const COPIES: u64 = 8;

/// How an honest node trains in a round.
pub fn honest_options(seed: u64) -> TrainOptions {
    TrainOptions {
        steps: 60,
        batch_size: 16,
        learning_rate: 1e-3,
        seed,
        ..TrainOptions::default()
    }
}

/// All updates of a node that has the recording `own` and may have stolen from `other`.
pub fn updates(
    config: &PolicyConfig,
    base: &ExpertWeights,
    own: &Prepared,
    other: &Prepared,
) -> Result<Vec<Update>> {
    let mut all = Vec::new();
    for sigma in NOISES {
        let noisy = (0..COPIES).map(|seed| noisy(config, base, sigma, seed));
        all.push(Update {
            origin: format!("{NOISE}, {sigma} of a tensor's size"),
            weights: noisy.collect::<Result<_>>()?,
            banded: false,
        });
    }
    let mut trained =
        |origin: &str, steps: usize, samples: &dyn Fn(usize) -> Vec<PreparedSample>| {
            let weights = (0..COPIES).map(|seed| {
                let options = TrainOptions {
                    steps,
                    ..honest_options(seed)
                };
                let samples = samples(seed as usize);
                Ok(train(config, base, &samples, &options, &mut |_| ())?.weights)
            });
            all.push(Update {
                origin: origin.into(),
                weights: weights.collect::<Result<_>>()?,
                banded: false,
            });
            Result::Ok(())
        };
    let steps = honest_options(0).steps;
    trained("one honest step", 1, &|_| own.samples.clone())?;
    trained("stolen from another task", steps, &|_| {
        other.samples.clone()
    })?;
    trained("trained on four other samples", steps, &|copy| {
        let from = copy * 4 % (other.samples.len() - 4);
        other.samples[from..from + 4].to_vec()
    })?;
    trained("honest, 60 steps", steps, &|_| own.samples.clone())?;
    trained("honest, 300 steps", 5 * steps, &|_| own.samples.clone())?;
    let weights = all.last().map_or(vec![], |honest| honest.weights.clone());
    all.push(Update {
        origin: BANDED.into(),
        weights,
        banded: true,
    });
    Ok(all)
}

/// The weights with normal noise of `sigma` times the root mean square of each tensor.
fn noisy(
    config: &PolicyConfig,
    base: &ExpertWeights,
    sigma: f32,
    seed: u64,
) -> Result<ExpertWeights> {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut tensors = base.tensors().clone();
    for tensor in tensors.values_mut() {
        let squares: f32 = tensor.data.iter().map(|x| x * x).sum();
        let size = (squares / tensor.data.len() as f32).sqrt();
        for x in &mut tensor.data {
            *x += sigma * size * normal(&mut random);
        }
    }
    Ok(ExpertWeights::from_tensors(config, tensors)?)
}

/// A standard normal number (Box and Muller, 1958).
fn normal(random: &mut ChaCha8Rng) -> f32 {
    let (u, v) = (
        random.random_range(f32::EPSILON..1.0),
        random.random::<f32>(),
    );
    (-2.0 * u.ln()).sqrt() * (std::f32::consts::TAU * v).cos()
}
