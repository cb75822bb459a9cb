//! Random weights for a whole policy: a seed gives the same bits on every machine.
//!
//! No pretrained weights have the micro profile's size. Its frozen half is a fixed random feature map, scaled so that values have about
//! unit size and the expert can learn.

use rand::SeedableRng;
use rand_chacha::ChaCha20Rng;
use rayon::prelude::*;
use sha2::{Digest, Sha256};
use zk0_lerobot::config::PolicyConfig;
use zk0_lerobot::layout::policy_layout;
use zk0_tensors::{TensorData, TensorSet};

use crate::error::Result;
use crate::policy::random::uniform;
use crate::policy::weights::Policy;

/// A policy with random weights. Each tensor has its own ChaCha20 stream, keyed by the seed and its name: new tensors do not change it.
///
/// # Errors
/// The configuration is not valid.
pub fn init_policy(config: &PolicyConfig, seed: u64) -> Result<Policy> {
    config.validate()?;
    let tensors: TensorSet = policy_layout(config)
        .into_par_iter()
        .map(|(name, shape)| {
            let elements = shape.iter().product();
            let data = match Start::of(&name, &shape, config) {
                Start::Constant(value) => vec![value; elements],
                Start::Uniform(std) => {
                    let mut rng = stream(seed, &name);
                    let reach = 3f64.sqrt() * f64::from(std);
                    (0..elements)
                        .map(|_| (reach * (2.0 * uniform(&mut rng) - 1.0)) as f32)
                        .collect()
                }
            };
            (name, TensorData { shape, data })
        })
        .collect();
    Ok(Policy::split(config, tensors))
}

enum Start {
    Constant(f32),
    /// With this standard deviation; exact, unlike a normal.
    Uniform(f32),
}

impl Start {
    fn of(name: &str, shape: &[usize], config: &PolicyConfig) -> Self {
        if name.ends_with(".bias") {
            return Self::Constant(0.0);
        }
        if shape.len() == 1 {
            return Self::Constant(1.0); // gains of norms
        }
        let fan_in: usize = shape[1..].iter().product();
        let unit = 1.0 / (fan_in as f32).sqrt();
        let text_width = config.text.width as f32;
        Self::Uniform(if name.contains("position_embedding") {
            0.5
        } else if name.contains("embed_tokens") || name.contains("connector") {
            // Embeddings are multiplied by sqrt(width).
            unit.min(1.0 / text_width.sqrt())
        } else if name.contains("action_out_proj") {
            // The loss starts near that of v = 0.
            0.1 * unit
        } else if name.ends_with("o_proj.weight") || name.ends_with("down_proj.weight") {
            // Keeps unit size of the sum over layers.
            unit / (2.0 * config.text.layers as f32).sqrt()
        } else {
            unit
        })
    }
}

fn stream(seed: u64, name: &str) -> ChaCha20Rng {
    let mut hash = Sha256::new();
    hash.update(b"zk0/init-policy/v1\0");
    hash.update(seed.to_le_bytes());
    hash.update(name.as_bytes());
    ChaCha20Rng::from_seed(hash.finalize().into())
}
