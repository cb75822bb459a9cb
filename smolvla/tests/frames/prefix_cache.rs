//! The prefix cache makes the samples of a recording once. They are the same as without the cache.

use std::fs;
use std::path::Path;
use std::process::Command;
use std::sync::atomic::{AtomicUsize, Ordering};

use candle_core::Device;
use zk0_lerobot::dataset::Dataset;
use zk0_smolvla::frames::batch::SampleSource;
use zk0_smolvla::frames::prefix_cache::{
    CacheKey, DiskCache, FileDigests, FrameMaker, FrameNames, FrameSource, KeySpace, PreparedFrames,
};
use zk0_smolvla::frames::sample::{ObservedSample, PreparedSample, Preparer};
use zk0_smolvla::policy::frozen::{FrozenPlace, FrozenPrecision};
use zk0_smolvla::policy::tokenizer::WordHash;
use zk0_smolvla::policy::weights::Policy;
use zk0_smolvla::PolicyError;

use super::setting::{copy, frames, policy, recording, PLENTY};

fn direct(policy: &Policy, dataset: &Dataset, count: usize) -> Vec<PreparedSample> {
    let tokenizer = WordHash::new(&policy.config);
    let preparer = Preparer::new(policy, &tokenizer).unwrap();
    let mut loader = dataset.loader(policy.config.chunk_size).unwrap();
    (0..count)
        .map(|index| preparer.prepare_frame(dataset, &mut loader, index).unwrap())
        .collect()
}

fn all(source: &FrameSource<PreparedSample>) -> Vec<PreparedSample> {
    (0..source.len())
        .map(|i| source.sample(i).unwrap().into_owned())
        .collect()
}

#[test]
fn samples_are_made_once_and_come_back_bit_for_bit() {
    let (policy, count) = (policy(), 40);
    let tokenizer = WordHash::new(&policy.config);
    let datasets = [Dataset::open(recording()).unwrap()];
    let frames = frames(&policy, &datasets[0], count);
    let expected = direct(&policy, &datasets[0], count);
    let dir = tempfile::tempdir().unwrap();
    let loaded = AtomicUsize::new(0);
    let maker = || {
        FrameMaker::new(&datasets, policy.config.chunk_size, || {
            loaded.fetch_add(1, Ordering::Relaxed);
            Preparer::new(&policy, &tokenizer)
        })
    };
    let bytes = {
        let (cache, maker) = (DiskCache::open(dir.path(), PLENTY).unwrap(), maker());
        let source = FrameSource::<PreparedSample>::new(&cache, &maker, frames.clone());
        let mut seen = Vec::new();
        let filled = source.fill(|done, of| seen.push((done, of))).unwrap();
        assert_eq!((filled.found, filled.made, filled.beyond), (0, count, 0));
        assert_eq!(seen, (1..=count).map(|i| (i, count)).collect::<Vec<_>>());
        assert_eq!(all(&source), expected);
        cache.bytes()
    };
    assert_eq!(loaded.load(Ordering::Relaxed), 1);

    // The next process needs neither the frozen half nor a video.
    let unneeded = FrameMaker::new(&datasets, policy.config.chunk_size, || {
        Err(PolicyError::Sample("made again".into()))
    });
    let cache = DiskCache::open(dir.path(), PLENTY).unwrap();
    let source = FrameSource::<PreparedSample>::new(&cache, &unneeded, frames.clone());
    assert_eq!(source.fill(|_, _| ()).unwrap().found, count);
    assert_eq!(all(&source), expected);
    assert_eq!(cache.bytes(), bytes);

    // An entry that the disk has spoilt is made again, and stored again.
    let name = frames[3].key.to_string();
    let path = dir
        .path()
        .join(format!("entries/{}/{name}.sample", &name[..2]));
    let mut spoilt = fs::read(&path).unwrap();
    let good = spoilt.clone();
    spoilt[500] ^= 4;
    fs::write(&path, spoilt).unwrap();
    let (cache, maker) = (DiskCache::open(dir.path(), PLENTY).unwrap(), maker());
    let source = FrameSource::<PreparedSample>::new(&cache, &maker, frames);
    assert_eq!(all(&source), expected);
    assert_eq!(loaded.load(Ordering::Relaxed), 2);
    assert_eq!(fs::read(&path).unwrap(), good);
}

#[test]
fn prepared_frames_are_the_same_with_a_cache_and_without() {
    let (policy, count) = (policy(), 12);
    let tokenizer = WordHash::new(&policy.config);
    let datasets = [Dataset::open(recording()).unwrap()];
    let expected = direct(&policy, &datasets[0], count);
    let dir = tempfile::tempdir().unwrap();
    let cache = DiskCache::open(dir.path(), PLENTY).unwrap();
    let indices: Vec<usize> = (0..count).collect();
    for cache in [None, Some(&cache), Some(&cache)] {
        let space = KeySpace::new::<PreparedSample>(&policy, &FrozenPlace::default());
        let mut names = FrameNames::new(space, &policy.config, &tokenizer, cache);
        let named = names.frames(0, &datasets[0], &indices).unwrap();
        assert_eq!(named, frames(&policy, &datasets[0], count));
        let maker = FrameMaker::new(&datasets, policy.config.chunk_size, || {
            Preparer::new(&policy, &tokenizer)
        });
        let mut done = 0;
        let prepared = PreparedFrames::<PreparedSample>::prepare(cache, &maker, named, |n, of| {
            assert_eq!(of, count);
            done = n;
        });
        let prepared = prepared.unwrap();
        assert_eq!((done, prepared.len()), (count, count));
        assert_eq!(*prepared.sample(3).unwrap(), expected[3]);
        assert!(prepared.sample(count).is_err());
        assert_eq!(prepared.into_samples().unwrap(), expected);
    }
    assert!(dir.path().join("files.json").exists());
}

const FULL: &str = "ZK0_TEST_THE_DISK_IS_FULL";

#[test]
fn a_full_disk_costs_time_and_changes_nothing() {
    if std::env::var_os(FULL).is_none() {
        // A limit on the size of files stands for the full disk. It is of a whole process, so the test runs in one of its own.
        let name = concat!(
            module_path!(),
            "::a_full_disk_costs_time_and_changes_nothing"
        );
        let (_, name) = name.split_once("::").unwrap();
        let output = Command::new("bash")
            .args(["-c", "trap '' XFSZ; ulimit -f 0; exec \"$@\"", "bash"])
            .arg(std::env::current_exe().unwrap())
            .args(["--exact", name, "--nocapture"])
            .env(FULL, "1")
            .output()
            .unwrap();
        let reported = String::from_utf8_lossy(&output.stdout);
        let ran = output.status.success() && reported.contains("1 passed");
        assert!(ran, "{reported}{}", String::from_utf8_lossy(&output.stderr));
        return;
    }
    let (policy, count) = (policy(), 4);
    let tokenizer = WordHash::new(&policy.config);
    let datasets = [Dataset::open(recording()).unwrap()];
    let dir = tempfile::tempdir().unwrap();
    let cache = DiskCache::open(dir.path(), PLENTY).unwrap();
    let space = KeySpace::new::<PreparedSample>(&policy, &FrozenPlace::default());
    let mut names = FrameNames::new(space, &policy.config, &tokenizer, Some(&cache));
    let indices: Vec<usize> = (0..count).collect();
    let named = names.frames(0, &datasets[0], &indices).unwrap();
    let maker = FrameMaker::new(&datasets, policy.config.chunk_size, || {
        Preparer::new(&policy, &tokenizer)
    });
    let source = FrameSource::<PreparedSample>::new(&cache, &maker, named);
    let filled = source.fill(|_, _| ()).unwrap();
    assert_eq!((filled.made, filled.beyond), (0, count));
    assert_eq!(all(&source), direct(&policy, &datasets[0], count));
    assert_eq!(cache.bytes(), 0);
}

#[test]
fn a_small_budget_costs_time_and_changes_nothing() {
    let (policy, count) = (policy(), 12);
    let tokenizer = WordHash::new(&policy.config);
    let datasets = [Dataset::open(recording()).unwrap()];
    let expected = direct(&policy, &datasets[0], count);
    let dir = tempfile::tempdir().unwrap();
    // A sample of this profile takes about 4 kB.
    let budget = 20_000;
    let cache = DiskCache::open(dir.path(), budget).unwrap();
    let maker = FrameMaker::new(&datasets, policy.config.chunk_size, || {
        Preparer::new(&policy, &tokenizer)
    });
    let frames = frames(&policy, &datasets[0], count);
    let source = FrameSource::<PreparedSample>::new(&cache, &maker, frames);
    let filled = source.fill(|_, _| ()).unwrap();
    assert!(filled.made > 0 && filled.beyond > 0, "{filled:?}");
    assert_eq!(filled.made + filled.beyond, count);
    assert_eq!(all(&source), expected);
    assert!(cache.bytes() <= budget);
}

/// Without a cache nothing is kept, neither in memory nor on disk.
#[test]
fn without_a_cache_each_sample_is_made_whenever_it_is_needed() {
    let (policy, count) = (policy(), 6);
    let tokenizer = WordHash::new(&policy.config);
    let datasets = [Dataset::open(recording()).unwrap()];
    let expected = direct(&policy, &datasets[0], count);
    let loaded = AtomicUsize::new(0);
    let maker = FrameMaker::new(&datasets, policy.config.chunk_size, || {
        loaded.fetch_add(1, Ordering::Relaxed);
        Preparer::new(&policy, &tokenizer)
    });
    let frames = frames(&policy, &datasets[0], count);
    let source = FrameSource::<PreparedSample>::new(None, &maker, frames);
    let filled = source.fill(|_, _| ()).unwrap();
    assert_eq!((filled.found, filled.made, filled.beyond), (0, 0, count));
    for time in 1..3 {
        assert_eq!(all(&source), expected);
        assert_eq!(loaded.load(Ordering::Relaxed), time);
        // The frozen half of the policy is read again after a rest.
        source.rest();
    }
}

#[test]
fn a_key_is_a_function_of_all_that_makes_the_sample() {
    let policy = policy();
    let tokenizer = WordHash::new(&policy.config);
    let keys = |policy: &Policy, folder: &Path| -> Vec<CacheKey> {
        let dataset = Dataset::open(folder).unwrap();
        let frames = frames(policy, &dataset, dataset.len());
        frames.into_iter().map(|frame| frame.key).collect()
    };
    let of_recording = keys(&policy, &recording());
    let mut different = of_recording.clone();
    different.sort();
    different.dedup();
    assert_eq!(
        different.len(),
        of_recording.len(),
        "every frame has its own"
    );

    // The name of the folder does not change the keys.
    let dir = tempfile::tempdir().unwrap();
    let moved = dir.path().join("moved");
    copy(&recording(), &moved);
    assert_eq!(keys(&policy, &moved), of_recording);

    // Other weights, dimensions or kinds of samples give other keys.
    let mut other = policy.clone();
    let tensor = other.frozen.values_mut().next_back().unwrap();
    tensor.data[0] += 1.0;
    assert!(keys(&other, &moved)
        .iter()
        .all(|key| !of_recording.contains(key)));
    let mut other = policy.clone();
    other.config.max_language_tokens += 1;
    assert!(keys(&other, &moved)
        .iter()
        .all(|key| !of_recording.contains(key)));
    let place = FrozenPlace::default();
    let observed = KeySpace::new::<ObservedSample>(&policy, &place);
    assert_ne!(observed, KeySpace::new::<PreparedSample>(&policy, &place));
    // Another precision of the frozen half also gives other keys, for both kinds of samples.
    let rounded = FrozenPlace::on(Device::Cpu, Some(FrozenPrecision::Bf16));
    assert_ne!(observed, KeySpace::new::<ObservedSample>(&policy, &rounded));
    assert_ne!(
        KeySpace::new::<PreparedSample>(&policy, &place),
        KeySpace::new::<PreparedSample>(&policy, &rounded)
    );
    let dataset = Dataset::open(&moved).unwrap();
    let key = observed.keys(
        &policy.config,
        &tokenizer,
        &dataset,
        &[0],
        &mut FileDigests::default(),
    );
    assert!(!of_recording.contains(&key.unwrap()[0]));
    // Observed samples end before the state projection, so its weights do not matter.
    let mut trained = policy.clone();
    trained
        .frozen
        .get_mut("model.state_proj.bias")
        .unwrap()
        .data[0] += 1.0;
    assert_eq!(KeySpace::new::<ObservedSample>(&trained, &place), observed);

    // Other statistics, instructions or pictures give other keys.
    let change = |file: &str, change: &dyn Fn(&mut Vec<u8>)| {
        let folder = tempfile::tempdir().unwrap();
        copy(&recording(), folder.path());
        let path = folder.path().join(file);
        let mut bytes = fs::read(&path).unwrap();
        change(&mut bytes);
        fs::write(path, bytes).unwrap();
        let changed = keys(&policy, folder.path());
        let pairs = changed.iter().zip(&of_recording);
        pairs.filter(|(a, b)| a != b).count()
    };
    let stats = |bytes: &mut Vec<u8>| {
        let mut json: serde_json::Value = serde_json::from_slice(bytes).unwrap();
        let mean = &mut json["observation.state"]["mean"][0];
        *mean = serde_json::json!(mean.as_f64().unwrap() + 0.5);
        *bytes = serde_json::to_vec(&json).unwrap();
    };
    assert_eq!(change("meta/stats.json", &stats), of_recording.len());
    let dataset = Dataset::open(recording()).unwrap();
    let video = &dataset.episodes()[0].videos[0].as_ref().unwrap().path;
    let in_it = dataset.episodes().iter();
    let in_it = in_it.filter(|episode| &episode.videos[0].as_ref().unwrap().path == video);
    let in_it: usize = in_it.map(|episode| episode.frames.len()).sum();
    let video = video.strip_prefix(recording()).unwrap();
    let last = |bytes: &mut Vec<u8>| *bytes.last_mut().unwrap() ^= 1;
    assert_eq!(change(video.to_str().unwrap(), &last), in_it);
    assert!(in_it > 0 && in_it < of_recording.len());
}
