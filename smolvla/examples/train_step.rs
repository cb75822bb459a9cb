//! What a training step takes: seconds and memory, on prepared samples made of random numbers (as many tokens as the longest
//! prefix has). The time of a step does not depend on the numbers.
//!
//! `cargo run --release -p zk0-smolvla --example train_step -- PROFILE BATCH STEPS`

use std::error::Error;
use std::time::Instant;

use rand::SeedableRng;
use rand_chacha::ChaCha20Rng;
use zk0_smolvla::batch::InMemory;
use zk0_smolvla::init::init_policy;
use zk0_smolvla::random::uniform;
use zk0_smolvla::sample::PreparedSample;
use zk0_smolvla::train::{Samples, TrainOptions, Trainer};
use zk0_smolvla::{PolicyConfig, Profile};

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [profile, batch, steps] = arguments.as_slice() else {
        return Err("usage: train_step PROFILE BATCH STEPS".into());
    };
    let config = Profile::from_name(profile)?.config();
    let options = TrainOptions {
        steps: steps.parse()?,
        batch_size: batch.parse()?,
        ..TrainOptions::default()
    };
    let samples = samples(&config, options.batch_size + 1);
    let start = init_policy(&config, 1)?.expert;
    let samples = InMemory::new(&config, &samples)?;
    let mut trainer = Trainer::new(&config, &start, Samples::Prepared(&samples), options)?;
    drop(start);
    let mut seconds = Vec::new();
    while !trainer.is_done() {
        let clock = Instant::now();
        trainer.step()?;
        seconds.push(clock.elapsed().as_secs_f64());
    }
    seconds.sort_by(f64::total_cmp);
    println!(
        "{profile}, batch {batch}: {:.3} s a step (median of {}, fastest {:.3}), peak memory {:.2} GB",
        seconds[seconds.len() / 2],
        seconds.len(),
        seconds[0],
        peak_memory()?
    );
    Ok(())
}

fn samples(config: &PolicyConfig, count: usize) -> Vec<PreparedSample> {
    let mut rng = ChaCha20Rng::seed_from_u64(1);
    let mut vector = |len: usize| -> Vec<f32> {
        (0..len)
            .map(|_| (2.0 * uniform(&mut rng) - 1.0) as f32)
            .collect()
    };
    let tokens = config.max_prefix_tokens();
    let width = tokens * config.kv_width();
    (0..count)
        .map(|_| PreparedSample {
            prefix_tokens: tokens,
            keys: (0..config.text.layers).map(|_| vector(width)).collect(),
            values: (0..config.text.layers).map(|_| vector(width)).collect(),
            actions: vector(config.chunk_elements()),
            is_pad: vec![false; config.chunk_size],
        })
        .collect()
}

/// Peak of the process, in GB; Linux tells.
fn peak_memory() -> Result<f64, Box<dyn Error>> {
    let status = std::fs::read_to_string("/proc/self/status")?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
    let kb: f64 = line.unwrap_or("").trim().trim_end_matches(" kB").parse()?;
    Ok(kb * 1024.0 / 1e9)
}
