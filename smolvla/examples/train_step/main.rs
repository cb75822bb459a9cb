//! Times training steps on random weights and random frames, and prints one JSON line:
//! `train_step PROFILE BATCH WHAT STEPS [DEVICE]`.
//!
//! WHAT is one of
//! - `whole`: LeRobot's step. Pictures are resized, the frozen half runs, expert and `state_proj` are trained;
//! - `cached`: the expert is trained over frames whose frozen half is in a cache on disk, read from there in every step;
//! - `cached-state`: expert and `state_proj` are trained over such a cache of pictures and language.
//!
//! A step is forward, backward, clipping and AdamW. The first is not counted: it sets up memory and threads. Printed are the losses before the
//! first and the last step. The same arguments give the same losses on each device, but for rounding.
//! DEVICE is `cpu`, or with feature `cuda` a GPU, where the frozen half multiplies in bf16.

mod over_cache;

use std::collections::BTreeMap;
use std::process::ExitCode;
use std::time::Instant;

use candle_core::{Tensor, Var};
use over_cache::run;
use rand::SeedableRng;
use rand_chacha::ChaCha20Rng;
use zk0_lerobot::config::PolicyConfig;
use zk0_lerobot::layout::trainable_layout;
use zk0_smolvla::frames::image::vision_input;
use zk0_smolvla::frames::sample::{ObservedSample, PreparedSample};
use zk0_smolvla::measure::evaluate::FlowDraw;
use zk0_smolvla::policy::device::device;
use zk0_smolvla::policy::frozen::FrozenPlace;
use zk0_smolvla::policy::init::init_policy;
use zk0_smolvla::policy::model::expert::ExpertModel;
use zk0_smolvla::policy::model::flow::{losses, mean_loss, noisy_actions, target_velocity};
use zk0_smolvla::policy::model::kernels::gradients::backward;
use zk0_smolvla::policy::model::key_values::PrefixCache;
use zk0_smolvla::policy::model::prefix::{CameraInput, PrefixInput, PrefixModel};
use zk0_smolvla::policy::model::PolicyParameters;
use zk0_smolvla::policy::profile::Profile;
use zk0_smolvla::train::optimizer::{AdamW, AdamWOptions, Optimizer};
use zk0_smolvla::train::TrainingSamples;

/// The allocator is that of the `zk0` binary.
#[global_allocator]
static ALLOCATOR: zk0_smolvla::policy::memory::Allocator = zk0_smolvla::policy::memory::Allocator;

type Failure = Box<dyn std::error::Error>;

/// The height and width of the recorded pictures: those of a webcam, or those of the tiny fixture.
fn recorded(profile: Profile) -> (usize, usize) {
    if profile == Profile::Full {
        (480, 640)
    } else {
        (48, 64)
    }
}

/// Some numbers.
fn wave(count: usize) -> Vec<f32> {
    (0..count).map(|i| (i as f32 * 0.618).sin()).collect()
}

struct Bench {
    config: PolicyConfig,
    size: (usize, usize),
    batch: usize,
    variables: BTreeMap<String, Var>,
    prefix: PrefixModel,
    expert: ExpertModel,
    optimizer: AdamW,
    /// Every camera's pictures, one after another: 8-bit RGB (3, height, width).
    pictures: Vec<u8>,
    state: Tensor,
    actions: Tensor,
    rng: ChaCha20Rng,
}

impl Bench {
    fn new(profile: Profile, batch: usize, place: &FrozenPlace) -> Result<Self, Failure> {
        let config = profile.config();
        let device = &place.device;
        let policy = init_policy(&config, 1)?;
        let mut all = policy.frozen;
        all.extend(policy.expert.into_tensors());
        let trainable = trainable_layout(&config, true);
        let (parameters, variables) = PolicyParameters::with_variables(all, &trainable, device)?;
        let mut rng = ChaCha20Rng::seed_from_u64(2);
        let (height, width) = recorded(profile);
        let values =
            |shape: &[usize]| Tensor::from_vec(wave(shape.iter().product()), shape, device);
        let mut pictures = vec![0; batch * config.cameras * 3 * height * width];
        rand::RngCore::fill_bytes(&mut rng, &mut pictures);
        Ok(Self {
            size: (height, width),
            batch,
            prefix: PrefixModel::new(&config, &parameters.in_precision(place.precision))?,
            expert: ExpertModel::new(&config, &parameters)?,
            optimizer: AdamW::new(&variables, AdamWOptions::default())?,
            variables,
            pictures,
            state: values(&[batch, config.max_state_dim])?,
            actions: values(&[batch, config.chunk_size, config.max_action_dim])?,
            rng,
            config,
        })
    }

    /// What the prefix is made of: the batch's pictures, resized, and words.
    fn input(&self) -> Result<PrefixInput, Failure> {
        let (size, (height, width)) = (self.config.vision.image_size, self.size);
        let device = self.state.device();
        let one = 3 * height * width;
        let camera = |slot: usize| -> Result<CameraInput, Failure> {
            let pictures = self.pictures.chunks_exact(one).skip(slot * self.batch);
            let pixels = pictures
                .take(self.batch)
                .flat_map(|picture| vision_input(picture, self.size, size));
            let pixels: Vec<f32> = pixels.collect();
            Ok(CameraInput {
                pixels: Tensor::from_vec(pixels, (self.batch, 3, size, size), device)?,
                present: vec![true; self.batch],
            })
        };
        let length = self.config.max_language_tokens.min(48);
        let ids =
            (0..self.batch * length).map(|i| (i * 7 % (self.config.text.vocabulary - 1)) as u32);
        Ok(PrefixInput {
            cameras: (0..self.config.cameras)
                .map(camera)
                .collect::<Result<_, _>>()?,
            tokens: Tensor::from_iter(ids, device)?.reshape((self.batch, length))?,
            token_mask: vec![vec![true; length]; self.batch],
            state: self.state.clone(),
        })
    }

    /// Makes one step over `cache`, and returns the loss before it.
    fn step(&mut self, cache: &PrefixCache) -> Result<f32, Failure> {
        let draws: Vec<FlowDraw> = (0..self.batch)
            .map(|_| FlowDraw::random(&self.config, &mut self.rng))
            .collect();
        let times: Vec<f32> = draws.iter().map(|draw| draw.time).collect();
        let noise: Vec<f32> = draws.into_iter().flat_map(|draw| draw.noise).collect();
        let noise = Tensor::from_vec(noise, self.actions.shape(), self.actions.device())?;
        let x_t = noisy_actions(&self.actions, &noise, &times)?;
        let velocity = self.expert.forward(cache, &x_t, &times)?;
        let loss = mean_loss(&losses(
            &velocity,
            &target_velocity(&self.actions, &noise)?,
        )?)?;
        self.optimizer.step(&backward(&loss)?, 1e-4)?;
        Ok(loss.to_scalar()?)
    }
}

/// The results of the steps that were timed.
struct Measured {
    /// The seconds of each step, including the first one.
    seconds: Vec<f64>,
    /// The loss before each step.
    losses: Vec<f32>,
    /// How many parameters were trained.
    trained: usize,
}

fn whole(
    profile: Profile,
    batch: usize,
    steps: usize,
    place: &FrozenPlace,
) -> Result<Measured, Failure> {
    let mut bench = Bench::new(profile, batch, place)?;
    let (mut seconds, mut losses) = (Vec::new(), Vec::new());
    for _ in 0..=steps {
        let started = Instant::now();
        // A gradient reaches `state_proj` through the prefix.
        let cache = bench.prefix.cache_training_state(&bench.input()?)?;
        losses.push(bench.step(&cache)?);
        seconds.push(started.elapsed().as_secs_f64());
    }
    let trained = bench.variables.values().map(|v| v.elem_count()).sum();
    Ok(Measured {
        seconds,
        losses,
        trained,
    })
}

/// The largest resident set of this process so far, in bytes.
fn peak_memory() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status
        .lines()
        .find_map(|line| line.strip_prefix("VmHWM:"))?;
    let kilobytes: u64 = line.split_whitespace().next()?.parse().ok()?;
    Some(1024 * kilobytes)
}

fn main() -> ExitCode {
    let Err(error) = measure() else {
        return ExitCode::SUCCESS;
    };
    eprintln!("train_step: {error}");
    ExitCode::FAILURE
}

fn measure() -> Result<(), Failure> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [profile, batch, what, steps, device_name @ ..] = arguments.as_slice() else {
        return Err(
            "usage: train_step tiny|micro|full BATCH whole|cached|cached-state STEPS [DEVICE]"
                .into(),
        );
    };
    let device_name = device_name.first().map_or("cpu", String::as_str);
    let place = FrozenPlace::on(device(device_name)?, None);
    let profile_named = Profile::from_name(profile)?;
    let (batch, steps): (usize, usize) = (batch.parse()?, steps.parse()?);
    let mut measured = match what.as_str() {
        "whole" => whole(profile_named, batch, steps, &place)?,
        "cached" => run::<PreparedSample>(profile_named, batch, steps, &place, |kept| {
            TrainingSamples::Prepared(kept)
        })?,
        "cached-state" => run::<ObservedSample>(profile_named, batch, steps, &place, |kept| {
            TrainingSamples::Observed(kept)
        })?,
        other => return Err(format!("`{other}` is none of whole, cached, cached-state").into()),
    };
    measured.seconds.remove(0);
    measured.seconds.sort_by(f64::total_cmp);
    let median = measured.seconds.get(measured.seconds.len() / 2);
    // This is the memory of this machine. The memory of a GPU is not measured.
    let memory = peak_memory().filter(|_| place.device.is_cpu());
    println!(
        "{}",
        serde_json::json!({
            "side": "zk0", "profile": profile, "batch": batch, "what": what, "steps": steps,
            "step_seconds": median, "peak_memory_bytes": memory,
            "trained_parameters": measured.trained,
            "first_loss": measured.losses.first(), "loss": measured.losses.last(),
            "device": device_name, "frozen_precision": place.precision.name(),
        })
    );
    Ok(())
}
