//! A run of training that is stopped at any step and resumed ends with the bytes of one that never stopped.

use std::fs;
use std::path::Path;

use rand::SeedableRng;
use rand_chacha::ChaCha20Rng;
use zk0_lerobot::config::PolicyConfig;
use zk0_smolvla::frames::batch::SamplesInMemory;
use zk0_smolvla::frames::sample::{ObservedSample, PreparedSample};
use zk0_smolvla::policy::frozen::FrozenPlace;
use zk0_smolvla::policy::init::init_policy;
use zk0_smolvla::policy::profile::Profile;
use zk0_smolvla::policy::random::normal;
use zk0_smolvla::policy::weights::Policy;
use zk0_smolvla::train::schedule::Schedule;
use zk0_smolvla::train::snapshots::{RunIdentity, SnapshotError, Snapshots};
use zk0_smolvla::train::{TrainOptions, Trainer, TrainingSamples};

const STEPS: usize = 7;

fn config() -> PolicyConfig {
    Profile::Micro.config()
}

fn policy() -> Policy {
    init_policy(&config(), 7).unwrap()
}

fn options() -> TrainOptions {
    TrainOptions {
        steps: STEPS,
        batch_size: 3,
        learning_rate: 3e-3,
        schedule: Schedule::CosineWarmRestarts {
            first_period: 3,
            factor: 2,
            floor: 0.1,
        },
        fedprox_mu: 0.1,
        seed: 11,
        ..TrainOptions::default()
    }
}

struct Noise(ChaCha20Rng);

impl Noise {
    fn new() -> Self {
        Self(ChaCha20Rng::seed_from_u64(5))
    }

    fn vector(&mut self, len: usize) -> Vec<f32> {
        (0..len).map(|_| normal(&mut self.0)).collect()
    }

    /// Returns an action chunk. In some chunks the last frames are padding.
    fn actions(&mut self, i: usize) -> (Vec<f32>, Vec<bool>) {
        let c = config();
        let is_pad = (0..c.chunk_size).map(|t| t + i % 4 > c.chunk_size);
        (self.vector(c.chunk_elements()), is_pad.collect())
    }
}

/// Ten samples with prefixes of different lengths.
fn prepared() -> Vec<PreparedSample> {
    let (c, mut noise) = (config(), Noise::new());
    (0..10)
        .map(|i| {
            let tokens = c.max_prefix_tokens() - i % 3;
            let mut layers = || -> Vec<Vec<f32>> {
                let width = tokens * c.kv_width();
                (0..c.text.layers).map(|_| noise.vector(width)).collect()
            };
            let (keys, values) = (layers(), layers());
            let (actions, is_pad) = noise.actions(i);
            PreparedSample {
                prefix_tokens: tokens,
                keys,
                values,
                actions,
                is_pad,
            }
        })
        .collect()
}

/// Returns the same samples without the last token, and with states.
fn observed() -> Vec<ObservedSample> {
    let (c, mut noise) = (config(), Noise::new());
    let without_state = |mut sample: PreparedSample| {
        sample.prefix_tokens -= 1;
        let values = sample.prefix_tokens * c.kv_width();
        let layers = sample.keys.iter_mut().chain(&mut sample.values);
        layers.for_each(|layer| layer.truncate(values));
        ObservedSample {
            observed: sample,
            state: noise.vector(c.max_state_dim),
        }
    };
    prepared().into_iter().map(without_state).collect()
}

/// A trainer that has made no step.
fn trainer<'a>(
    policy: &Policy,
    samples: TrainingSamples<'a>,
    options: TrainOptions,
) -> Trainer<'a> {
    let frozen = match samples {
        TrainingSamples::Prepared(_) => None,
        TrainingSamples::Observed(_) => Some(&policy.frozen),
    };
    let cpu = FrozenPlace::default();
    Trainer::on(
        &cpu,
        &policy.config,
        &policy.expert,
        frozen,
        samples,
        options,
    )
    .unwrap()
}

fn run(trainer: &mut Trainer, until: usize) {
    while trainer.steps_done() < until {
        trainer.step().unwrap();
    }
}

fn snapshots(folder: &Path, trainer: &Trainer) -> Snapshots {
    Snapshots::new(folder, 2, RunIdentity::of(trainer, &[1; 32]).unwrap()).unwrap()
}

fn stopped_anywhere(samples: TrainingSamples) {
    let policy = policy();
    let mut unbroken = trainer(&policy, samples, options());
    run(&mut unbroken, STEPS);
    let wanted = unbroken.values().unwrap();
    let dir = tempfile::tempdir().unwrap();
    for stop in 0..=STEPS {
        let folder = dir.path().join(stop.to_string());
        let mut first = trainer(&policy, samples, options());
        let saved = snapshots(&folder, &first);
        assert!(saved.is_empty().unwrap());
        run(&mut first, stop);
        saved.save(&first).unwrap();
        drop(first);

        let mut second = trainer(&policy, samples, options());
        let saved = snapshots(&folder, &second);
        assert_eq!(saved.resume(&mut second).unwrap(), Some(stop));
        assert_eq!(second.steps_done(), stop);
        run(&mut second, STEPS);
        assert_eq!(
            second.values().unwrap(),
            wanted,
            "stopped after step {stop}"
        );
    }
}

#[test]
fn the_expert_stopped_anywhere() {
    let samples = prepared();
    let samples = SamplesInMemory::new(&config(), &samples).unwrap();
    stopped_anywhere(TrainingSamples::Prepared(&samples));
}

#[test]
fn expert_and_state_projection_stopped_anywhere() {
    let samples = observed();
    let samples = SamplesInMemory::new(&config(), &samples).unwrap();
    stopped_anywhere(TrainingSamples::Observed(&samples));
}

/// A run with snapshots at steps 2, 4 and 6, of which two are kept. The tests damage them.
struct Kept {
    policy: Policy,
    samples: Vec<PreparedSample>,
    dir: tempfile::TempDir,
}

impl Kept {
    fn new() -> Self {
        let kept = Self {
            policy: policy(),
            samples: prepared(),
            dir: tempfile::tempdir().unwrap(),
        };
        kept.train();
        kept
    }

    fn train(&self) {
        let samples = SamplesInMemory::new(&config(), &self.samples).unwrap();
        let mut trainer = trainer(&self.policy, TrainingSamples::Prepared(&samples), options());
        let saved = snapshots(self.dir.path(), &trainer);
        for step in [2, 4, 6] {
            run(&mut trainer, step);
            saved.save(&trainer).unwrap();
        }
    }

    fn path(&self, file: &str) -> std::path::PathBuf {
        self.dir.path().join(file)
    }

    fn resume(&self, options: TrainOptions) -> Result<Option<usize>, SnapshotError> {
        let samples = SamplesInMemory::new(&config(), &self.samples).unwrap();
        let mut trainer = trainer(&self.policy, TrainingSamples::Prepared(&samples), options);
        snapshots(self.dir.path(), &trainer).resume(&mut trainer)
    }
}

#[test]
fn the_last_ones_are_kept() {
    let kept = Kept::new();
    let mut names: Vec<_> = fs::read_dir(kept.dir.path())
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .collect();
    names.sort();
    assert_eq!(names, ["000004", "000006"]);
    assert_eq!(kept.resume(options()).unwrap(), Some(6));
}

#[test]
fn a_damaged_one_is_skipped_for_the_one_before() {
    let change: [fn(&Kept); 6] = [
        |kept| {
            let path = kept.path("000006/weights.safetensors");
            let mut bytes = fs::read(&path).unwrap();
            let last = bytes.len() - 1;
            bytes[last] ^= 1;
            fs::write(path, bytes).unwrap();
        },
        |kept| {
            let path = kept.path("000006/moments.safetensors");
            let bytes = fs::read(&path).unwrap();
            fs::write(path, &bytes[..bytes.len() / 2]).unwrap();
        },
        |kept| fs::remove_file(kept.path("000006/moments.safetensors")).unwrap(),
        |kept| fs::remove_file(kept.path("000006/state.json")).unwrap(),
        |kept| fs::write(kept.path("000006/state.json"), "{\"version\":").unwrap(),
        // The folder's name states a later step than the snapshot in it.
        |kept| fs::rename(kept.path("000006"), kept.path("000009")).unwrap(),
    ];
    for (i, change) in change.into_iter().enumerate() {
        let kept = Kept::new();
        change(&kept);
        assert_eq!(kept.resume(options()).unwrap(), Some(4), "change {i}");
        fs::remove_dir_all(kept.path("000004")).unwrap();
        assert_eq!(kept.resume(options()).unwrap(), None, "change {i}");
    }
}

#[test]
fn what_was_being_written_is_no_snapshot_and_goes() {
    let kept = Kept::new();
    fs::rename(kept.path("000006"), kept.path(".unfinished-6")).unwrap();
    assert_eq!(kept.resume(options()).unwrap(), Some(4));
    assert!(!kept.path(".unfinished-6").exists());
}

#[test]
fn a_damaged_one_is_written_anew_when_its_step_comes_again() {
    let kept = Kept::new();
    fs::write(kept.path("000006/state.json"), "").unwrap();
    let samples = SamplesInMemory::new(&config(), &kept.samples).unwrap();
    let mut again = trainer(&kept.policy, TrainingSamples::Prepared(&samples), options());
    let saved = snapshots(kept.dir.path(), &again);
    assert_eq!(saved.resume(&mut again).unwrap(), Some(4));
    run(&mut again, 6);
    saved.save(&again).unwrap();
    assert_eq!(kept.resume(options()).unwrap(), Some(6));
}

#[test]
fn another_run_is_refused_and_says_what_differs() {
    let kept = Kept::new();
    let refused = |change: fn(&mut TrainOptions)| {
        let mut options = options();
        change(&mut options);
        kept.resume(options).unwrap_err().to_string()
    };
    let changes: [fn(&mut TrainOptions); 5] = [
        |o| o.seed = 12,
        |o| o.steps = 8,
        |o| o.learning_rate = 2e-3,
        |o| o.fedprox_mu = 0.2,
        |o| o.schedule = Schedule::Constant,
    ];
    for change in changes {
        let error = refused(change);
        assert!(error.contains("another run: its set of options"), "{error}");
        assert!(error.contains("000006"), "{error}");
    }

    let samples = SamplesInMemory::new(&config(), &kept.samples).unwrap();
    let other = init_policy(&config(), 8).unwrap();
    let mut of_other = trainer(&other, TrainingSamples::Prepared(&samples), options());
    let saved = snapshots(kept.dir.path(), &of_other);
    let error = saved.resume(&mut of_other).unwrap_err().to_string();
    assert!(error.contains("its start"), "{error}");

    let mut on_other = trainer(&kept.policy, TrainingSamples::Prepared(&samples), options());
    let run = RunIdentity::of(&on_other, &[2; 32]).unwrap();
    let saved = Snapshots::new(kept.dir.path(), 2, run).unwrap();
    let error = saved.resume(&mut on_other).unwrap_err().to_string();
    assert!(error.contains("its data"), "{error}");
}
