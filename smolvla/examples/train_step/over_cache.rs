//! Steps as `zk0 train` makes them once its frames are prepared: samples come from a cache on disk, are checked, made into a
//! batch, and trained on.

use std::borrow::Cow;
use std::time::Instant;

use rand::SeedableRng;
use rand_chacha::ChaCha20Rng;
use zk0_lerobot::config::PolicyConfig;
use zk0_lerobot::tokenizer::Tokenizer;
use zk0_smolvla::frames::batch::SampleSource;
use zk0_smolvla::frames::prefix_cache::entry::CacheEntry;
use zk0_smolvla::frames::prefix_cache::{CacheKey, DiskCache};
use zk0_smolvla::frames::sample::{CameraImage, FromFrame, Observation, Pixels, Preparer};
use zk0_smolvla::policy::frozen::FrozenPlace;
use zk0_smolvla::policy::init::init_policy;
use zk0_smolvla::policy::profile::Profile;
use zk0_smolvla::train::learner::state_part;
use zk0_smolvla::train::{TrainOptions, Trainer, TrainingSamples};
use zk0_smolvla::PolicyError;

use crate::{recorded, wave, Failure, Measured};

/// How many batches the cache holds.
const BATCHES: usize = 2;

/// A tokenizer that makes an instruction of full length from any text.
struct FullLength(PolicyConfig);

impl Tokenizer for FullLength {
    fn tokens(&self, _: &str) -> zk0_lerobot::error::Result<Vec<u32>> {
        let length = self.0.max_language_tokens.min(48);
        let ids = (0..length).map(|i| (i * 7 % (self.0.text.vocabulary - 1)) as u32);
        Ok(ids.collect())
    }
}

/// Samples by number, each read from the disk when it is asked for.
pub struct OnDisk {
    cache: DiskCache,
    keys: Vec<CacheKey>,
}

impl<S: CacheEntry + Clone> SampleSource<S> for OnDisk {
    fn len(&self) -> usize {
        self.keys.len()
    }

    fn sample(&self, index: usize) -> Result<Cow<'_, S>, PolicyError> {
        let wrong = |why: String| PolicyError::Sample(format!("sample {index}: {why}"));
        let sample = self.cache.get(&self.keys[index]);
        let sample = sample.map_err(|error| wrong(error.to_string()))?;
        Ok(Cow::Owned(sample.ok_or_else(|| wrong("not there".into()))?))
    }
}

/// Trains on samples of a kind, which decides what is trained.
pub fn run<S: FromFrame + CacheEntry>(
    profile: Profile,
    batch: usize,
    steps: usize,
    place: &FrozenPlace,
    samples: impl Fn(&OnDisk) -> TrainingSamples<'_>,
) -> Result<Measured, Failure> {
    let config = profile.config();
    // These weights stay in memory while samples are prepared, as in `zk0 train`.
    let policy = init_policy(&config, 1)?;
    let (expert, part) = (policy.expert, state_part(policy.frozen));
    let folder = tempfile::tempdir()?;
    let mut kept = OnDisk {
        cache: DiskCache::open(folder.path(), u64::MAX)?,
        keys: Vec::new(),
    };
    {
        let tokenizer = FullLength(config.clone());
        let preparer = Preparer::at(place, init_policy(&config, 1)?, &tokenizer)?;
        for number in 0..BATCHES * batch {
            let made = sample::<S>(&preparer, profile, number)?;
            let mut key = CacheKey([0; 32]);
            key.0[..8].copy_from_slice(&(number as u64).to_le_bytes());
            kept.cache.put(&key, &made)?;
            kept.keys.push(key);
        }
    }
    let options = TrainOptions {
        steps: steps + 1,
        batch_size: batch,
        ..TrainOptions::default()
    };
    let samples = samples(&kept);
    let frozen = match samples {
        TrainingSamples::Prepared(_) => None,
        TrainingSamples::Observed(_) => Some(&part),
    };
    let mut trainer = Trainer::on(place, &config, &expert, frozen, samples, options)?;
    drop((expert, part));
    let (mut seconds, mut losses) = (Vec::new(), Vec::new());
    while !trainer.is_done() {
        let started = Instant::now();
        losses.push(trainer.step()?.loss);
        seconds.push(started.elapsed().as_secs_f64());
    }
    let trained = trainer.values()?.values().map(|t| t.data.len()).sum();
    Ok(Measured {
        seconds,
        losses,
        trained,
    })
}

/// Runs the frozen half over a random frame of a recording.
fn sample<S: FromFrame>(
    preparer: &Preparer,
    profile: Profile,
    number: usize,
) -> Result<S, Failure> {
    let config = preparer.config();
    let mut rng = ChaCha20Rng::seed_from_u64(number as u64);
    let (height, width) = recorded(profile);
    let mut pictures = vec![0; config.cameras * 3 * height * width];
    rand::RngCore::fill_bytes(&mut rng, &mut pictures);
    let names: Vec<String> = (0..config.cameras)
        .map(|slot| format!("camera{slot}"))
        .collect();
    let camera = |(name, pixels)| CameraImage {
        name,
        height,
        width,
        pixels: Pixels::Bytes(pixels),
    };
    let seen = names
        .iter()
        .map(String::as_str)
        .zip(pictures.chunks_exact(3 * height * width));
    let observation = Observation {
        cameras: seen.map(camera).collect(),
        state: &wave(config.state_dim),
        actions: &wave(config.chunk_size * config.action_dim),
        is_pad: &vec![false; config.chunk_size],
        task: "",
    };
    Ok(S::from_frame(preparer, &observation)?)
}
