//! Samples are made in the background, and training is the same as without that, bit for bit.

use std::fs;
use std::path::Path;
use std::sync::Mutex;
use std::thread::{self, sleep, ThreadId};
use std::time::Duration;

use candle_core::Device;
use zk0_lerobot::dataset::Dataset;
use zk0_smolvla::frames::ahead::ahead;
use zk0_smolvla::frames::batch::SampleSource;
use zk0_smolvla::frames::prefix_cache::{DiskCache, FrameMaker, FrameRef, FrameSource};
use zk0_smolvla::frames::sample::{PreparedSample, Preparer};
use zk0_smolvla::policy::tokenizer::WordHash;
use zk0_smolvla::policy::weights::Policy;
use zk0_smolvla::train::{train, train_by_sgd, train_on, TrainOptions, TrainingSamples};
use zk0_testkit::until;

use super::setting::{copy, frames, policy, recording, PLENTY};

/// A recording, a policy, and which threads have loaded the policy's frozen half.
struct Setting {
    policy: Policy,
    tokenizer: WordHash,
    datasets: [Dataset; 1],
    loaded_by: Mutex<Vec<ThreadId>>,
}

impl Setting {
    fn of(recording: &Path) -> Self {
        let policy = policy();
        Self {
            tokenizer: WordHash::new(&policy.config),
            policy,
            datasets: [Dataset::open(recording).unwrap()],
            loaded_by: Mutex::default(),
        }
    }

    fn maker(&self) -> FrameMaker<'_> {
        FrameMaker::new(&self.datasets, self.policy.config.chunk_size, || {
            self.loaded_by.lock().unwrap().push(thread::current().id());
            Preparer::new(&self.policy, &self.tokenizer)
        })
    }

    fn frames(&self, count: usize) -> Vec<FrameRef> {
        frames(&self.policy, &self.datasets[0], count)
    }

    fn loaded_by(&self) -> Vec<ThreadId> {
        self.loaded_by.lock().unwrap().clone()
    }
}

fn options() -> TrainOptions {
    TrainOptions {
        steps: 12,
        batch_size: 7,
        learning_rate: 3e-3,
        seed: 4,
        ..TrainOptions::default()
    }
}

#[test]
fn training_with_samples_made_ahead_gives_the_same_bits() {
    let (setting, count) = (Setting::of(&recording()), 40);
    let (config, start) = (&setting.policy.config, &setting.policy.expert);
    let (maker, frames) = (setting.maker(), setting.frames(count));
    let source = FrameSource::<PreparedSample>::new(None, &maker, frames.clone());
    let all: Vec<_> = (0..count)
        .map(|index| source.sample(index).unwrap().into_owned())
        .collect();
    let expected = train(config, start, &all, &options(), &mut |_| ()).unwrap();

    // Twelve steps of seven samples go twice over the forty frames. A sample takes about 4 kB.
    for budget in [None, Some(PLENTY), Some(20_000)] {
        for by_asker in [false, true] {
            let dir = tempfile::tempdir().unwrap();
            let cache = budget.map(|budget| DiskCache::open(dir.path(), budget).unwrap());
            let maker = setting.maker().with_prefixes_by_asker(by_asker);
            let source = FrameSource::new(cache.as_ref(), &maker, frames.clone());
            let mut seen = Vec::new();
            let trained = train_on(
                &Device::Cpu,
                config,
                start,
                TrainingSamples::Prepared(&source),
                &options(),
                None,
                &mut |step| seen.push(step.step),
            );
            assert!(trained.unwrap() == expected, "{budget:?} {by_asker}");
            assert_eq!(seen, (1..=12).collect::<Vec<_>>());
            if budget == Some(PLENTY) {
                assert_eq!(source.in_cache(), count, "{by_asker}");
            }
        }
    }

    let by_sgd = |samples| {
        let trained = train_by_sgd(
            &Device::Cpu,
            config,
            start,
            samples,
            &options(),
            None,
            &mut |_| (),
        );
        trained.unwrap()
    };
    let in_memory = zk0_smolvla::frames::batch::SamplesInMemory::new(config, &all).unwrap();
    let expected = by_sgd(TrainingSamples::Prepared(&in_memory));
    assert!(by_sgd(TrainingSamples::Prepared(&source)) == expected);
}

#[test]
fn another_thread_runs_the_frozen_half_unless_the_asker_has_to() {
    let setting = Setting::of(&recording());
    for by_asker in [false, true] {
        setting.loaded_by.lock().unwrap().clear();
        let maker = setting.maker().with_prefixes_by_asker(by_asker);
        let source = FrameSource::<PreparedSample>::new(None, &maker, setting.frames(6));
        ahead(&source, |samples| {
            samples.expect(Box::new(0..6), 2);
            (0..6).for_each(|index| drop(samples.sample(index).unwrap()));
        });
        let by = setting.loaded_by();
        assert_eq!(by.len(), 1);
        assert_eq!(by[0] == thread::current().id(), by_asker);
    }
}

#[test]
fn no_more_samples_are_made_ahead_than_the_bound() {
    let (setting, count) = (Setting::of(&recording()), 200);
    let (maker, dir) = (setting.maker(), tempfile::tempdir().unwrap());
    let cache = DiskCache::open(dir.path(), PLENTY).unwrap();
    let source = FrameSource::<PreparedSample>::new(&cache, &maker, setting.frames(count));
    // One is taken, four are ready, and one waits for its place.
    let bound = 1 + 4 + 1;
    ahead(&source, |samples| {
        samples.expect(Box::new(0..count), 4);
        samples.sample(0).unwrap();
        until("one waits", || source.in_cache() >= bound);
        sleep(Duration::from_millis(100));
        assert_eq!(source.in_cache(), bound);

        // Other orders may follow at any time, and each begins anew.
        samples.expect(Box::new((0..count).rev()), 4);
        samples.sample(count - 1).unwrap();
        until("one waits", || source.in_cache() >= 2 * bound);
    });
    // The threads have ended, and did not go on when the work was over.
    let made = source.in_cache();
    assert!(made <= 2 * bound + 2, "{made}");
}

#[test]
fn samples_that_were_not_announced_can_be_had_at_any_time() {
    let (setting, count) = (Setting::of(&recording()), 12);
    let maker = setting.maker();
    let source = FrameSource::<PreparedSample>::new(None, &maker, setting.frames(count));
    let expected: Vec<_> = (0..count).map(|i| source.sample(i).unwrap()).collect();
    ahead(&source, |samples| {
        samples.expect(Box::new((0..count).rev()), 3);
        for index in [3, 11, 3, 10, 0, 9, 8, 8, 7, 6, 5, 4, 3, 2, 1, 0, 0, 5] {
            assert_eq!(samples.sample(index).unwrap(), expected[index], "{index}");
        }
        assert!(samples.sample(count).is_err());
        samples.expect(Box::new([2, count, 1].into_iter()), 3);
        assert_eq!(samples.sample(2).unwrap(), expected[2]);
        let error = samples.sample(count).unwrap_err();
        assert_eq!(
            error.to_string(),
            source.sample(count).unwrap_err().to_string()
        );
        assert_eq!(samples.sample(1).unwrap(), expected[1]);
    });
}

/// A frame that cannot be decoded is an error of the step that takes it, and has its name.
#[test]
fn an_error_comes_in_its_place_and_names_the_frame() {
    let dir = tempfile::tempdir().unwrap();
    let damaged = dir.path().join("damaged");
    copy(&recording(), &damaged);
    let video = damaged.join("videos/observation.images.top/chunk-000/file-001.mp4");
    let mut bytes = fs::read(&video).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle..middle + 6000].fill(0xa5);
    fs::write(&video, bytes).unwrap();

    let setting = Setting::of(&damaged);
    let (maker, count) = (setting.maker(), setting.datasets[0].len());
    let source = FrameSource::<PreparedSample>::new(None, &maker, setting.frames(count));
    let had = |samples: &dyn SampleSource<PreparedSample>, index| {
        let sample = samples.sample(index);
        sample
            .map(|sample| sample.into_owned())
            .map_err(|error| error.to_string())
    };
    let expected: Vec<_> = (0..count).map(|index| had(&source, index)).collect();
    let faulty = expected.iter().position(Result::is_err).unwrap();
    assert!(faulty > 0 && expected.last().unwrap().is_ok());
    let error = expected[faulty].as_ref().unwrap_err();
    let name = format!("frame {faulty} of recording 0: episode ");
    assert!(error.starts_with(&name), "{error}");
    assert!(error.contains(video.to_str().unwrap()), "{error}");
    ahead(&source, |samples| {
        samples.expect(Box::new(0..count), 5);
        for (index, expected) in expected.iter().enumerate() {
            assert!(had(samples, index) == *expected, "{index}");
        }
    });

    let (config, start) = (&setting.policy.config, &setting.policy.expert);
    let options = TrainOptions {
        steps: count,
        ..options()
    };
    let samples = TrainingSamples::Prepared(&source);
    let device = &Device::Cpu;
    let failed = train_on(device, config, start, samples, &options, None, &mut |_| ());
    let error = failed.unwrap_err().to_string();
    assert!(error.contains(" of recording 0: "), "{error}");
}

#[test]
fn the_frozen_half_is_freed_when_all_samples_are_in_the_cache() {
    let (setting, count) = (Setting::of(&recording()), 12);
    let (maker, dir) = (setting.maker(), tempfile::tempdir().unwrap());
    let cache = DiskCache::open(dir.path(), PLENTY).unwrap();
    let frames = setting.frames(count);
    let source = FrameSource::<PreparedSample>::new(&cache, &maker, frames.clone());
    let order = [3, 1, 0, 2, 11, 10, 9, 8, 7, 6, 5, 4];
    let expected = ahead(&source, |samples| {
        samples.expect(Box::new(order.into_iter()), 4);
        order.map(|index| samples.sample(index).unwrap().into_owned())
    });
    assert_eq!(setting.loaded_by().len(), 1);

    // A sample that has to be made again needs the frozen half again.
    let name = frames[10].key.to_string();
    let path = format!("entries/{}/{name}.sample", &name[..2]);
    fs::write(dir.path().join(path), b"damaged").unwrap();
    assert_eq!(*source.sample(10).unwrap(), expected[5]);
    assert_eq!(setting.loaded_by().len(), 2);
}
