//! A node commits to the drawn frames of its recording, keeps their samples on disk, and opens them for its claims. An auditor who has
//! the recording finds the same samples.

mod auditing;
mod on_disk;
mod transforms;

use serde_json::json;
use std::fs;
use zk0_argument::claim::ClaimSource;
use zk0_circuits::model::sample::Sample;
use zk0_circuits::Digest;
use zk0_lerobot::dataset::Dataset;
use zk0_lerobot::tokenizer::{Tokenizer, TrainedTokenizer};
use zk0_node::recording::{prepare_samples, OpenRecording};
use zk0_protocol::evaluation_set::{draw, total};
use zk0_smolvla::frames::batch::SampleSource;
use zk0_smolvla::frames::prefix_cache::DiskCache;
use zk0_smolvla::measure::fixed_point::quantise_sample;
use zk0_smolvla::policy::policy_file::PolicyFile;
use zk0_testkit::made_recording::{make, MadeEpisode};
use zk0_testkit::micro_network::{pickplace, Setting};
use zk0_verifier::dataset::check_leaf_list;

/// The commitment does not depend on where the samples come from.
#[test]
fn a_commitment_is_the_same_with_and_without_the_cache() {
    let setting = Setting::new();
    let dir = tempfile::tempdir().unwrap();
    let plain = setting.registered(&pickplace(), None, 40);
    for _ in 0..2 {
        let cache = DiskCache::open(dir.path(), 1 << 30).unwrap();
        assert_eq!(setting.registered(&pickplace(), Some(&cache), 40), plain);
    }
    // A cache without room changes nothing either.
    let cache = DiskCache::open(dir.path(), 1).unwrap();
    assert_eq!(setting.registered(&pickplace(), Some(&cache), 40), plain);
}

/// The tokens are those of the policy's tokenizer, and samples of other tokens are not taken from the cache.
#[test]
fn instructions_are_read_with_the_policy_s_own_tokenizer() {
    let setting = Setting::new();
    // This tokenizer knows no word of the recording. Each word becomes token 5.
    let definition = json!({
        "version": "1.0", "truncation": null, "padding": null, "added_tokens": [],
        "normalizer": null, "pre_tokenizer": {"type": "Whitespace"}, "post_processor": null, "decoder": null,
        "model": {"type": "WordLevel", "vocab": {"?": 5}, "unk_token": "?"}
    });
    let config = &setting.file.policy.config;
    let trained = TrainedTokenizer::parse(&definition.to_string(), config).unwrap();
    assert_eq!(trained.tokens("one two three").unwrap(), [5, 5, 5]);
    let own = Setting::of(PolicyFile {
        policy: setting.file.policy.clone(),
        tokenizer: trained.into(),
    });
    let dir = tempfile::tempdir().unwrap();
    let cache = DiskCache::open(dir.path(), 1 << 30).unwrap();
    let hashed = setting.registered(&pickplace(), Some(&cache), 40);
    let with = own.registered(&pickplace(), None, 40);
    assert_ne!(with.0.dataset.root, hashed.0.dataset.root);
    assert_eq!(own.registered(&pickplace(), Some(&cache), 40), with);
    assert_eq!(setting.registered(&pickplace(), Some(&cache), 40), hashed);
}

/// Frames are counted through the episodes in the order of their digests, and each is the frame that it was recorded as.
#[test]
fn registered_frames_are_those_of_their_episodes() {
    let setting = Setting::new();
    let recording = OpenRecording::open(&pickplace(), &setting.policy(), None).unwrap();
    let dataset = Dataset::open(pickplace()).unwrap();
    let digests: Vec<Digest> = dataset.episode_digests().map(Digest).collect();
    let (episodes, mut first) = (recording.episodes(), 0);
    assert!(episodes.is_sorted_by(|one, next| one.digest < next.digest));
    assert_eq!(total(&episodes), dataset.len() as u64);
    for episode in &episodes {
        let number = digests.iter().position(|digest| *digest == episode.digest);
        let frames = dataset.episodes()[number.unwrap()].frames.clone();
        assert_eq!(frames.len(), episode.frames as usize);
        for within in 0..episode.frames {
            let found = recording.frame(first + u64::from(within));
            assert_eq!(found, Some(frames.start + within as usize));
        }
        first += u64::from(episode.frames);
    }
    assert_eq!(recording.frame(first), None);
    assert_eq!(recording.frame(u64::MAX), None);
}

/// A copy of an episode is one episode, so it adds no frames to the draw.
#[test]
fn a_repeated_episode_counts_once() {
    let setting = Setting::new();
    let episode = |seed| MadeEpisode {
        seed,
        frames: 20,
        still: false,
    };
    let open = |seeds: &[u64]| {
        let dir = tempfile::tempdir().unwrap();
        let episodes: Vec<_> = seeds.iter().map(|seed| episode(*seed)).collect();
        make(dir.path(), &episodes);
        let recording = OpenRecording::open(dir.path(), &setting.policy(), None).unwrap();
        (recording.len(), recording.episodes())
    };
    let (frames, once) = open(&[1, 2, 3]);
    assert_eq!((frames, once.len()), (60, 3));
    let (frames, repeated) = open(&[1, 2, 1, 3, 1]);
    assert_eq!((frames, repeated), (100, once));
}

/// The camera and the robot stand still. The node can register nevertheless, and equal samples count once.
#[test]
fn a_still_recording_is_registered_with_its_distinct_samples() {
    let setting = Setting::new();
    let dir = tempfile::tempdir().unwrap();
    let episode = |seed| MadeEpisode {
        seed,
        frames: 30,
        still: true,
    };
    make(dir.path(), &[episode(1), episode(2)]);
    let (registration, list) = setting.registered(dir.path(), None, 40);
    let found = registration.dataset.samples;
    // Frames near the end of an episode differ by their padding.
    assert!((2..40).contains(&found), "{found}");
    assert_eq!(registration.drawn(), 40);
    check_leaf_list(&registration, &list).unwrap();

    // A private input opens each of the distinct samples under its own path.
    let recording = OpenRecording::open(dir.path(), &setting.policy(), None).unwrap();
    let maker = recording.maker();
    let samples = recording.samples(&maker);
    let folder = tempfile::tempdir().unwrap();
    let set = setting.set(&recording, &samples, folder.path(), 40);
    let expected = setting.expected(&set, 0, found as u32);
    let weights = setting.weights();
    let input = set.private_input(&samples, &expected, weights.clone(), weights);
    setting.check_openings(&input.unwrap().whole().unwrap());
}

/// What goes to the prover is read from the disk, and is what would be there if all samples were in memory.
#[test]
fn the_private_input_from_disk_is_that_from_memory() {
    let setting = Setting::new();
    let dataset = Dataset::open(pickplace()).unwrap();
    let in_memory: Vec<Sample> = prepare_samples(&dataset, &setting.file, None)
        .unwrap()
        .iter()
        .map(|sample| quantise_sample(&setting.spec, sample).unwrap())
        .collect();
    let recording = OpenRecording::open(&pickplace(), &setting.policy(), None).unwrap();
    let maker = recording.maker();
    let samples = recording.samples(&maker);
    let folder = tempfile::tempdir().unwrap();
    let set = setting.set(&recording, &samples, folder.path(), 40);
    let files = fs::read_dir(folder.path()).unwrap().count();
    assert_eq!((set.commitment.samples, files), (40, 40));
    let drawn = draw(&setting.network, &recording.episodes(), 40).unwrap();
    for challenge in 0..5 {
        let expected = setting.expected(&set, challenge, 7);
        let weights = setting.weights();
        let input = set.private_input(&samples, &expected, weights.clone(), weights);
        let input = input.unwrap().whole().unwrap().into_owned();
        assert_eq!(input.openings.len(), 7);
        for opening in &input.openings {
            let frame = recording.frame(drawn[opening.index as usize]).unwrap();
            assert_eq!(opening.sample, in_memory[frame]);
        }
        setting.check_openings(&input);
    }
    assert_eq!(samples.len(), 245);
}
