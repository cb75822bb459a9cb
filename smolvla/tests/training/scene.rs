//! A frame of the micro profile, and samples made of it.

use rand::SeedableRng;
use rand_chacha::ChaCha20Rng;
use zk0_lerobot::config::PolicyConfig;
use zk0_smolvla::frames::sample::{
    CameraImage, FromFrame, Observation, ObservedSample, Pixels, PreparedSample, Preparer,
};
use zk0_smolvla::measure::evaluate::{evaluate, FlowDraw};
use zk0_smolvla::policy::frozen::FrozenPlace;
use zk0_smolvla::policy::init::init_policy;
use zk0_smolvla::policy::profile::Profile;
use zk0_smolvla::policy::tokenizer::WordHash;
use zk0_smolvla::policy::weights::{ExpertWeights, Policy};
use zk0_smolvla::train::TrainOptions;
use zk0_smolvla::PolicyError;

pub fn config() -> PolicyConfig {
    Profile::Micro.config()
}

pub fn policy() -> Policy {
    init_policy(&config(), 7).unwrap()
}

/// What a frame is made of, owned, so that a test can spoil a part.
pub struct Scene {
    pub pictures: Vec<(&'static str, usize, usize, Vec<u8>)>,
    pub state: Vec<f32>,
    pub actions: Vec<f32>,
    pub is_pad: Vec<bool>,
    pub task: &'static str,
}

impl Scene {
    /// Frame `k` of a smooth motion: a bright spot and six joints go round together; the last frames' chunks are padded.
    pub fn at(k: usize) -> Self {
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

    pub fn prepare(&self) -> Result<PreparedSample, PolicyError> {
        self.made()
    }

    pub fn observe(&self) -> Result<ObservedSample, PolicyError> {
        self.made()
    }

    pub fn made<S: FromFrame>(&self) -> Result<S, PolicyError> {
        self.made_at(&FrozenPlace::default(), &policy())
    }

    pub fn made_at<S: FromFrame>(
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
                pixels: Pixels::Bytes(pixels),
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

pub fn samples() -> Vec<PreparedSample> {
    (0..48).map(|k| Scene::at(k).prepare().unwrap()).collect()
}

pub fn options(seed: u64, steps: usize) -> TrainOptions {
    TrainOptions {
        steps,
        batch_size: 16,
        learning_rate: 3e-3,
        seed,
        ..TrainOptions::default()
    }
}

pub fn held_out(weights: &ExpertWeights, samples: &[PreparedSample]) -> f64 {
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
