//! Compares the reader with LeRobot itself: every value that `LeRobotDataset.__getitem__` returned for the fixtures' recordings.

use std::collections::BTreeMap;

use safetensors::{Dtype, SafeTensors};
use zk0_lerobot::dataset::{
    rgb_from_yuv, ColorMatrix, Colors, Dataset, FormatVersion, Frame, Normalizer, Sampling, Stats,
    VideoReader, Yuv, YuvFormat,
};
use zk0_testkit::recordings::{fixtures, frames, open, Copy, STATS};

const YUV420P: YuvFormat = YuvFormat {
    sampling: Sampling::Yuv420,
    bits: 8,
    colors: Colors {
        matrix: ColorMatrix::Bt601,
        full_range: false,
    },
};

const RECORDINGS: [&str; 5] = [
    "so100_pickplace",
    "so100_stacking",
    "so100_sorting",
    "so101_pickplace",
    "so100_pickplace_v21",
];

fn samples(name: &str) -> Vec<u8> {
    std::fs::read(fixtures().join(format!("samples/{name}.safetensors"))).unwrap()
}

/// What was dumped of each recording.
fn index() -> serde_json::Value {
    let read = |file: &str| -> serde_json::Value {
        serde_json::from_slice(&std::fs::read(fixtures().join("samples").join(file)).unwrap())
            .unwrap()
    };
    let mut index = read("index.json");
    index["so100_pickplace_v21"] = read("index_v21.json")["so100_pickplace_v21"].take();
    index
}

fn f32s(bytes: &[u8]) -> Vec<f32> {
    bytes
        .chunks_exact(4)
        .map(|b| f32::from_le_bytes(b.try_into().unwrap()))
        .collect()
}

fn f32_bytes(values: &[f32]) -> Vec<u8> {
    values.iter().flat_map(|v| v.to_le_bytes()).collect()
}

/// Computes the bytes that LeRobot's dump holds under `key` from what was read.
fn expected(dataset: &Dataset, frame: &Frame, key: &str) -> Option<Vec<u8>> {
    let int = |n: usize| Some((n as i64).to_le_bytes().to_vec());
    match key {
        "episode_index" => int(frame.episode),
        "frame_index" => int(frame.frame),
        "index" => int(frame.index),
        "task_index" => int(frame.task_index),
        "timestamp" => Some(f32_bytes(&[frame.timestamp])),
        "observation.state" => Some(f32_bytes(&frame.state)),
        "action" => Some(f32_bytes(&frame.actions)),
        "action_is_pad" => Some(frame.action_is_pad.iter().map(|&p| p.into()).collect()),
        _ => {
            // Observations are taken at the frame itself, which is never padding.
            if let Some(observation) = key.strip_suffix("_is_pad") {
                return (expected(dataset, frame, observation).is_some()).then(|| vec![0]);
            }
            let camera = dataset.cameras().iter().position(|c| c.name == key)?;
            Some(frame.images[camera].pixels.clone())
        }
    }
}

#[test]
fn every_dumped_value_is_read_bit_for_bit() {
    let index = index();
    for name in RECORDINGS {
        let about = &index[name];
        let dataset = open(name);
        let bytes = samples(name);
        let dump = SafeTensors::deserialize(&bytes).unwrap();

        let mut seen: BTreeMap<usize, usize> = BTreeMap::new();
        for (key, tensor) in dump.tensors() {
            let (at, rest) = key.split_once('.').unwrap();
            let at: usize = at.parse().unwrap();
            let (chunk, rest) = match rest.strip_prefix("chunk50.") {
                Some(rest) => (50, rest),
                None => (about["chunk"].as_u64().unwrap() as usize, rest),
            };
            let frame = dataset.frame(at, chunk).unwrap();
            let ours = expected(&dataset, &frame, rest)
                .unwrap_or_else(|| panic!("{name} {key}: nothing of that name was read"));
            assert!(ours == tensor.data(), "{name} {key} differs from LeRobot's");
            *seen.entry(at).or_default() += 1;
        }
        let listed: Vec<usize> = serde_json::from_value(about["indices"].clone()).unwrap();
        assert_eq!(seen.keys().copied().collect::<Vec<_>>(), listed, "{name}");
        // index.json lists the keys of one index. The chunk of 50 is dumped for two of the indices, in two tensors each.
        let keys = about["keys"].as_object().unwrap().len();
        let all = keys * listed.len() + 2 * 2;
        assert_eq!(seen.values().sum::<usize>(), all, "{name}");

        for (at, task) in about["tasks"].as_object().unwrap() {
            let frame = dataset.frame(at.parse().unwrap(), 1).unwrap();
            assert_eq!(frame.task, task.as_str().unwrap(), "{name} {at}");
        }
        let lengths: Vec<usize> = dataset.episodes().iter().map(|e| e.frames.len()).collect();
        let listed: Vec<usize> = serde_json::from_value(about["episode_lengths"].clone()).unwrap();
        assert_eq!(lengths, listed, "{name}");
        assert_eq!(dataset.len(), about["frames"].as_u64().unwrap() as usize);
        assert_eq!(dataset.fps(), 30);
    }
}

#[test]
fn reading_in_order_gives_what_random_access_gives() {
    for name in RECORDINGS {
        let dataset = open(name);
        let in_order: Vec<Frame> = frames(&dataset, 10).collect::<Result<_, _>>().unwrap();
        assert_eq!(in_order.len(), dataset.len());
        let mut loader = dataset.loader(10).unwrap();
        // The test goes backwards, in steps that skip over key frames (every second frame is one).
        for at in (0..dataset.len()).rev().step_by(7) {
            assert!(loader.frame(at).unwrap() == in_order[at], "{name} {at}");
        }
    }
}

#[test]
fn cameras_keep_the_order_of_info_json() {
    let names = |name| -> Vec<String> {
        open(name)
            .cameras()
            .iter()
            .map(|c| c.name.clone())
            .collect()
    };
    assert_eq!(
        names("so101_pickplace"),
        ["observation.images.up", "observation.images.side"]
    );
    assert_eq!(
        names("so100_sorting"),
        ["observation.images.top", "observation.images.wrist"]
    );
}

#[test]
fn planes_become_rgb_bit_for_bit() {
    let bytes = samples("planes");
    let planes = SafeTensors::deserialize(&bytes).unwrap();
    let mut pictures = 0;
    for (key, rgb) in planes.tensors() {
        let Some(picture) = key.strip_suffix(".rgb") else {
            continue;
        };
        let plane = |p: &str| planes.tensor(&format!("{picture}.{p}")).unwrap();
        let (y, u, v) = (plane("y"), plane("u"), plane("v"));
        let &[height, width] = y.shape() else {
            panic!()
        };
        let ours = rgb_from_yuv(&Yuv {
            format: YUV420P,
            y: y.data(),
            u: u.data(),
            v: v.data(),
            y_stride: width,
            uv_stride: u.shape()[1],
            height,
            width,
        })
        .unwrap();
        // The dump's order is height, width, channel. Ours is channel, height, width.
        let theirs: Vec<u8> = (0..3)
            .flat_map(|c| rgb.data()[c..].iter().step_by(3).copied())
            .collect();
        assert!(ours == theirs, "{picture}");

        // The decoder gives the same picture for this frame of the file.
        let (stem, number) = picture.rsplit_once('.').unwrap();
        let (name, camera) = stem.split_once('.').unwrap();
        let path = fixtures().join(format!(
            "datasets/{name}/videos/{camera}/chunk-000/file-000.mp4"
        ));
        let mut video = VideoReader::open(&path, height, width).unwrap();
        assert!(
            video.rgb(number.parse().unwrap()).unwrap() == theirs,
            "{picture}"
        );
        pictures += 1;
    }
    assert!(pictures >= 5);
}

#[test]
fn odd_sizes_repeat_the_last_chroma_sample() {
    let picture = Yuv {
        format: YUV420P,
        y: &[126; 9],
        u: &[128; 4],
        v: &[128; 4],
        y_stride: 3,
        uv_stride: 2,
        height: 3,
        width: 3,
    };
    assert_eq!(rgb_from_yuv(&picture), Some(vec![128; 27]));
    let short = Yuv {
        u: &[128; 3],
        ..picture
    };
    assert_eq!(rgb_from_yuv(&short), None);
}

#[test]
fn states_and_actions_normalise_as_in_lerobot_and_back() {
    let (bytes, index) = (samples("normalized"), index());
    let dump = SafeTensors::deserialize(&bytes).unwrap();
    for name in RECORDINGS {
        let dataset = open(name);
        let Some(at) = index[name]["normalized_index"].as_u64() else {
            assert_eq!(name, "so100_pickplace_v21");
            continue;
        };
        let at = at as usize;
        let frame = dataset.loader(10).unwrap().motion(at).unwrap();
        let tensor = |what: &str| {
            let tensor = dump.tensor(&format!("{name}.{what}")).unwrap();
            assert_eq!(tensor.dtype(), Dtype::F32);
            f32s(tensor.data())
        };
        let mut state = frame.state.clone();
        assert_eq!(state, tensor("state"));
        dataset.stats().state.normalize(&mut state);
        assert_eq!(state, tensor("state_normalized"));

        let mut actions = frame.actions.clone();
        assert_eq!(actions, tensor("action"));
        dataset.stats().action.normalize(&mut actions);
        assert_eq!(actions, tensor("action_normalized"));
        dataset.stats().action.denormalize(&mut actions);
        assert_eq!(actions, tensor("action_unnormalized"));
    }
}

/// Mean and standard deviation of rows, computed in float64 from the rows themselves.
fn moments<'a>(rows: impl Iterator<Item = &'a [f32]> + Clone) -> Normalizer {
    let dim = rows.clone().next().unwrap().len();
    let count = rows.clone().count() as f64;
    let mean = |value: &dyn Fn(&[f32]) -> f64| rows.clone().map(value).sum::<f64>() / count;
    let (means, stds) = (0..dim)
        .map(|d| {
            let middle = mean(&|row| f64::from(row[d]));
            let variance = mean(&|row| (f64::from(row[d]) - middle).powi(2));
            (middle as f32, variance.sqrt() as f32)
        })
        .unzip();
    Normalizer::new(means, stds).unwrap()
}

#[track_caller]
fn alike(a: &Normalizer, b: &Normalizer, tolerance: f32) {
    let pairs = a
        .mean()
        .iter()
        .zip(b.mean())
        .chain(a.std().iter().zip(b.std()));
    for (a, b) in pairs {
        assert!((a - b).abs() < tolerance * a.abs().max(1.0), "{a} {b}");
    }
}

#[test]
fn statistics_of_the_episodes_pool_into_those_of_the_recording() {
    let (old, new) = (open("so100_pickplace_v21"), open("so100_pickplace"));
    assert_eq!(
        (old.info().format, new.info().format),
        (FormatVersion::V21, FormatVersion::V30)
    );
    // The same recordings have statistics per episode and statistics of the whole. The test also compares with the values
    // themselves. LeRobot 0.4 adds up squares as it goes, which is less exact.
    alike(&old.stats().state, &new.stats().state, 1e-4);
    alike(&old.stats().action, &new.stats().action, 1e-4);
    alike(
        &old.stats().state,
        &moments((0..old.len()).map(|i| old.state(i).unwrap())),
        1e-5,
    );
    alike(
        &old.stats().action,
        &moments((0..old.len()).map(|i| old.action(i).unwrap())),
        1e-5,
    );
    assert_eq!(old.state(245), None);
    assert_eq!(old.action(245), None);
}

#[test]
fn statistics_of_other_dimensions_normalise_nothing() {
    let mut dataset = open("so100_pickplace");
    let other = Stats {
        state: Normalizer::identity(6).unwrap(),
        action: Normalizer::identity(7).unwrap(),
    };
    let error = dataset.normalise_with(other).unwrap_err().to_string();
    assert!(
        error.contains(
            "has 6 state and 6 action dimensions, the statistics to normalise it with have 6 and 7"
        ),
        "{error}"
    );
}

#[test]
fn v20_has_its_statistics_in_one_file() {
    let copy = Copy::of("so100_pickplace_v21");
    std::fs::remove_file(copy.path("meta/episodes_stats.jsonl")).unwrap();
    std::fs::copy(
        zk0_testkit::recordings::recording("so100_pickplace").join(STATS),
        copy.path(STATS),
    )
    .unwrap();
    copy.edit_text(zk0_testkit::recordings::INFO, "\"v2.1\"", "\"v2.0\"");
    let (ours, like) = (copy.open().unwrap(), open("so100_pickplace_v21"));
    assert_eq!(ours.info().format, FormatVersion::V20);
    assert!(ours.frame(122, 10).unwrap() == like.frame(122, 10).unwrap());
    assert_eq!(ours.stats().action, open("so100_pickplace").stats().action);
}

#[test]
fn feature_spec_tells_recordings_apart_and_not_more() {
    let spec = |name: &str, chunk| open(name).feature_spec_digest(chunk);
    // Recordings with the same arm, cameras and rate are interchangeable, whatever the task is.
    assert_eq!(spec("so100_pickplace", 10), spec("so100_stacking", 10));
    assert_ne!(spec("so100_pickplace", 10), spec("so100_pickplace", 50));
    assert_ne!(spec("so100_pickplace", 10), spec("so101_pickplace", 10));
    // This encoding must not change. Another encoding needs a new version of the tag.
    assert_eq!(
        hex::encode(spec("so100_pickplace", 50)),
        "2293dbe27783b069920d68babffb20150cfc7cefb339226784ef3c53f436e0c3"
    );
}

#[test]
fn requests_outside_the_recording_are_errors() {
    let dataset = open("so100_pickplace");
    let error = dataset.frame(245, 10).unwrap_err().to_string();
    assert_eq!(error, "there is no frame 245: the recording has 245 frames");
    assert!(dataset.frame(usize::MAX, 10).is_err());
    assert!(dataset.loader(0).is_err());
    assert!(dataset.loader(usize::MAX).is_err());
}

/// Prints the decoding speed. Run it with `--nocapture`.
#[test]
fn reading_in_order_keeps_up_with_training() {
    let dataset = open("so100_pickplace");
    let start = std::time::Instant::now();
    let frames = frames(&dataset, 50).filter(Result::is_ok).count();
    let seconds = start.elapsed().as_secs_f64();
    let pictures = frames * dataset.cameras().len();
    println!(
        "{frames} frames with {pictures} pictures of 96 x 128 in {seconds:.3} s: {:.0} pictures a second",
        pictures as f64 / seconds
    );
    assert_eq!(frames, 245);
}
