//! The readers that get random inputs, and the inputs that fuzzing starts from.

use std::fs;
use std::io::Cursor;

use openh264::encoder::Profile;
use zk0_lerobot::dataset::{recover, Mp4Track, VideoReader};
use zk0_lerobot::tokenizer::{Tokenizer, TrainedTokenizer};
use zk0_testkit::fuzzing::{Target, Targets};
use zk0_testkit::recordings::mp4_writer::encode;
use zk0_testkit::recordings::{fixtures, recording, Copy, DATA};

use super::hub_target::hub_listing;
use super::policy_targets;

pub const TARGETS: Targets = Targets {
    names: &NAMES,
    target,
    // Pictures, and tables of the libraries.
    slack: 24 << 20,
};

const NAMES: [&str; 20] = [
    "mp4",
    "h264",
    "av1",
    "stored_picture",
    "info_v30",
    "info_v21",
    "stats",
    "tasks_jsonl",
    "episodes_jsonl",
    "episodes_stats_jsonl",
    "tasks_parquet",
    "episodes_parquet",
    "data_parquet",
    "data_without_footer",
    "tokenizer",
    "tensor_file",
    "policy_json",
    "vlm_json",
    "processor_json",
    "hub_listing",
];

const HEIGHT: usize = 48;
const WIDTH: usize = 64;

fn target(name: &str) -> Target {
    let old = "so100_pickplace_v21";
    let new = "so100_pickplace";
    match name {
        "mp4" => Target {
            seeds: vec![
                video(Profile::High),
                av1(),
                other("hevc_hvc1"),
                other("h264_container_colors"),
            ],
            run: Box::new(|bytes| Mp4Track::read(&mut Cursor::new(bytes)).map(drop)),
        },
        "h264" => {
            let seeds = vec![video(Profile::Baseline), video(Profile::High)];
            pictures(seeds, HEIGHT, WIDTH)
        }
        "av1" => pictures(vec![av1()], 96, 128),
        "stored_picture" => stored_picture(),
        "info_v30" => in_folder(new, "meta/info.json"),
        "info_v21" => in_folder(old, "meta/info.json"),
        "stats" => in_folder(new, "meta/stats.json"),
        "tasks_jsonl" => in_folder(old, "meta/tasks.jsonl"),
        "episodes_jsonl" => in_folder(old, "meta/episodes.jsonl"),
        "episodes_stats_jsonl" => in_folder(old, "meta/episodes_stats.jsonl"),
        "tasks_parquet" => in_folder(new, "meta/tasks.parquet"),
        "episodes_parquet" => in_folder(new, "meta/episodes/chunk-000/file-000.parquet"),
        "data_parquet" => in_folder(old, "data/chunk-000/episode_000000.parquet"),
        "data_without_footer" => recovered(),
        "tokenizer" => tokenizer(),
        "tensor_file" => policy_targets::tensor_file(),
        "policy_json" => policy_targets::policy_json(),
        "vlm_json" => policy_targets::vlm_json(),
        "processor_json" => policy_targets::processor_json(),
        "hub_listing" => hub_listing(),
        other => panic!("no target {other}; there are {NAMES:?}"),
    }
}

/// Encodes a few frames of noise and gradients as H.264.
fn video(profile: Profile) -> Vec<u8> {
    let picture = |n: usize| {
        (0..3 * HEIGHT * WIDTH)
            .map(|i| (i * (n + 3) / 7) as u8)
            .collect()
    };
    let pictures: Vec<Vec<u8>> = (0..6).map(picture).collect();
    let stream = encode(&pictures, HEIGHT, WIDTH, profile, 3);
    stream.mp4_shown(HEIGHT, WIDTH, &[0, 2, 1, 3, 5, 4])
}

fn av1() -> Vec<u8> {
    let file = "videos/chunk-000/observation.images.wrist/episode_000001.mp4";
    fs::read(recording("so100_pickplace_v21").join(file)).unwrap()
}

fn other(name: &str) -> Vec<u8> {
    fs::read(fixtures().join(format!("videos_other/{name}.mp4"))).unwrap()
}

/// Reads the first pictures of a video of this size.
fn pictures(seeds: Vec<Vec<u8>>, height: usize, width: usize) -> Target {
    let dir = tempfile::tempdir().unwrap();
    Target {
        seeds,
        run: Box::new(move |bytes| {
            let path = dir.path().join("input");
            fs::write(&path, bytes).unwrap();
            let read = VideoReader::open(&path, height, width).and_then(|mut video| {
                (0..video.len().min(6)).try_for_each(|n| video.rgb(n).map(drop))
            });
            read.map_err(|e| e.to_string().replace(path.to_str().unwrap(), ""))
        }),
    }
}

/// Decodes a picture that a recording keeps in a file of its own.
fn stored_picture() -> Target {
    let folder = fixtures().join("pictures");
    let copy = Copy::empty();
    copy.add(&folder.join("lerobot"));
    copy.add(&folder.join("beside"));
    let file = "images/observation.images.top/episode-000000/frame-000000.png";
    let odd = |name: &str| fs::read(folder.join("odd").join(name)).unwrap();
    let seeds = vec![
        fs::read(copy.path(file)).unwrap(),
        odd("upright.jpg"),
        odd("progressive.jpg"),
    ];
    let dataset = copy.open().unwrap();
    Target {
        seeds,
        run: Box::new(move |bytes| {
            fs::write(copy.path(file), bytes).unwrap();
            let root = copy.root().to_str().unwrap();
            let read = dataset.frame(0, 10).map(drop);
            read.map_err(|e| e.to_string().replace(root, ""))
        }),
    }
}

/// Makes a recording in which only one file is damaged.
fn in_folder(name: &str, file: &'static str) -> Target {
    let copy = Copy::of(name);
    Target {
        seeds: vec![fs::read(copy.path(file)).unwrap()],
        run: Box::new(move |bytes| {
            fs::write(copy.path(file), bytes).unwrap();
            let root = copy.root().to_str().unwrap();
            copy.open()
                .map(drop)
                .map_err(|e| e.to_string().replace(root, ""))
        }),
    }
}

/// Recovers a recording that was ended by `kill -9`, in which only the data file is damaged.
fn recovered() -> Target {
    let copy = Copy::of("../unfinished_recordings/killed_between_episodes");
    let out = tempfile::tempdir().unwrap();
    Target {
        seeds: vec![fs::read(copy.path(DATA)).unwrap()],
        run: Box::new(move |bytes| {
            fs::write(copy.path(DATA), bytes).unwrap();
            let saved = out.path().join("saved");
            let result = recover(copy.root(), &saved).map(drop);
            let _ = fs::remove_dir_all(&saved);
            let [root, out] = [copy.root(), out.path()].map(|path| path.to_str().unwrap());
            result.map_err(|e| e.to_string().replace(root, "").replace(out, ""))
        }),
    }
}

fn tokenizer() -> Target {
    let dir = tempfile::tempdir().unwrap();
    let seed = serde_json::json!({
        "version": "1.0", "truncation": null, "padding": null,
        "added_tokens": [{"id": 8, "content": "<s>", "single_word": false, "lstrip": false, "rstrip": false,
            "normalized": false, "special": true}],
        "normalizer": {"type": "NFC"},
        "pre_tokenizer": {"type": "ByteLevel", "add_prefix_space": false, "trim_offsets": true, "use_regex": true},
        "post_processor": {"type": "TemplateProcessing",
            "single": [{"SpecialToken": {"id": "<s>", "type_id": 0}}, {"Sequence": {"id": "A", "type_id": 0}}],
            "pair": [{"Sequence": {"id": "A", "type_id": 0}}, {"Sequence": {"id": "B", "type_id": 1}}],
            "special_tokens": {"<s>": {"id": "<s>", "ids": [8], "tokens": ["<s>"]}}},
        "decoder": null,
        "model": {"type": "BPE", "dropout": null, "unk_token": null, "continuing_subword_prefix": null,
            "end_of_word_suffix": null, "fuse_unk": false, "byte_fallback": false,
            "vocab": {"r": 0, "e": 1, "d": 2, "Ġ": 3, "Ċ": 4, "re": 5, "red": 6, "Ġred": 7},
            "merges": ["r e", "re d", "Ġ red"]}
    });
    let mut config = policy_targets::config();
    config.max_language_tokens = 4;
    Target {
        seeds: vec![seed.to_string().into_bytes()],
        run: Box::new(move |bytes| {
            let path = dir.path().join("input");
            fs::write(&path, bytes).unwrap();
            TrainedTokenizer::read(&path, &config)
                .and_then(|tokenizer| tokenizer.tokens("red reed 1 🤖").map(drop))
                .map_err(|e| e.to_string().replace(path.to_str().unwrap(), ""))
        }),
    }
}
