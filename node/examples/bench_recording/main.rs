//! Measures how much memory and disk a node needs for a recording: it opens the recording, prepares its evaluation set, trains, and makes
//! its private input. Run it with `make bench-recording`.
//!
//! The recording is made: 50 episodes of 400 frames, whose motion follows from seeds, and whose pictures are those of a fixture, over and
//! over. Each profile is measured in a process of its own, because the peak of a process's memory never falls.
//! - `micro`: 512 frames are drawn, and training takes each of the 20,000 frames once. All frames are made.
//! - `full`, the published size, with random weights: **only 20 frames are drawn, and training makes one step**, because the frozen prefix
//!   takes seconds a frame on two cores. The claim evaluates 16 samples, and the step takes 32, as by default. One frame is made at a
//!   time, so the peak of memory does not depend on their number. The disk that 512 samples take is computed from those that were made.
//!
//! It prints one JSON line for each figure on standard output, and its progress on standard error. `peer` is what all samples of the
//! recording would take in memory, as float32 and in fixed point: it is computed from the size of one. `ratio` is `peer / ours`.

use std::error::Error;
use std::fs;
use std::path::Path;
use std::process::Command;
use std::time::Instant;
use zk0_argument::claim::ClaimSource;
use zk0_circuits::claim::challenge::sample_indices;
use zk0_circuits::claim::student::Confidence;
use zk0_circuits::claim::t_test::TTest;
use zk0_circuits::{Digest, Disclosure, EvalSpec, Mode, NodeId, Terms, WeightsDigest};
use zk0_node::recording::evaluation_set::{EvaluationSet, EvaluationSetSpec};
use zk0_node::recording::secret::RegistrationSecret;
use zk0_node::recording::OpenRecording;
use zk0_protocol::rules::bindings::ExpectedClaim;
use zk0_protocol::Rules;
use zk0_smolvla::frames::batch::SampleSource;
use zk0_smolvla::frames::prefix_cache::DiskCache;
use zk0_smolvla::measure::fixed_point::{dims, quantise_weights};
use zk0_smolvla::policy::device::Device;
use zk0_smolvla::policy::init::init_policy;
use zk0_smolvla::policy::policy_file::{self, PolicyFile};
use zk0_smolvla::train::{train_on, TrainOptions, TrainingSamples};
use zk0_smolvla::{ExpertWeights, Profile};
use zk0_testkit::made_recording::{make, MadeEpisode};
use zk0_verifier::dataset::check_leaf_list;

/// The allocator is that of the `zk0` binary.
#[global_allocator]
static ALLOCATOR: zk0_smolvla::policy::memory::Allocator = zk0_smolvla::policy::memory::Allocator;

type Result<T> = std::result::Result<T, Box<dyn Error>>;

const EPISODES: usize = 50;
const FRAMES: usize = 400;
const NETWORK: Digest = Digest([7; 32]);
const NODE: NodeId = NodeId([1; 32]);
/// Bytes of the prefix cache: the default of a node.
const CACHE_BYTES: u64 = 2_000_000_000;
const GIB: f64 = (1u64 << 30) as f64;

/// How much is done of a profile.
struct Work {
    profile: Profile,
    /// Frames drawn.
    drawn: u32,
    /// Steps of training, and samples in each.
    steps: usize,
    batch: usize,
    /// Samples that the claim evaluates.
    evaluated: u32,
}

impl Work {
    fn of(profile: Profile) -> Self {
        let few = profile == Profile::Full;
        Self {
            profile,
            drawn: if few {
                20
            } else {
                Rules::default().evaluation_frames
            },
            steps: if few { 1 } else { EPISODES * FRAMES / 32 },
            batch: 32, // as `zk0 node join` does by default
            evaluated: Rules::default().min_eval_samples,
        }
    }

    /// The options `--drawn`, `--steps` and `--batch` choose other numbers.
    fn with(mut self, options: &[(String, String)]) -> Result<Self> {
        for (name, value) in options {
            match name.as_str() {
                "--drawn" => self.drawn = value.parse()?,
                "--steps" => self.steps = value.parse()?,
                "--batch" => self.batch = value.parse()?,
                other => {
                    return Err(format!("{other}? There are --drawn, --steps and --batch").into())
                }
            }
        }
        self.evaluated = self.evaluated.min(self.drawn);
        Ok(self)
    }
}

fn main() -> Result<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let words: Vec<&str> = arguments.iter().map(String::as_str).collect();
    match words[..] {
        ["policy", profile, path] => write_policy(Profile::from_name(profile)?, Path::new(path)),
        ["measure", profile, dir, ..] => {
            let work = Work::of(Profile::from_name(profile)?).with(&pairs(&arguments[3..])?)?;
            measure(&work, Path::new(dir))
        }
        [] => {
            all("micro", &[])?;
            all("full", &[])
        }
        [profile, ..] => all(profile, &arguments[1..]),
    }
}

fn pairs(words: &[String]) -> Result<Vec<(String, String)>> {
    match words.as_chunks() {
        (pairs, []) => Ok(pairs
            .iter()
            .cloned()
            .map(|[name, value]| (name, value))
            .collect()),
        _ => Err("an option has no value".into()),
    }
}

/// Makes the recording and the policy, and measures the profile.
fn all(profile: &str, options: &[String]) -> Result<()> {
    let dir = tempfile::tempdir()?;
    let episode = |seed| MadeEpisode {
        seed,
        frames: FRAMES,
        still: false,
    };
    eprintln!("making a recording of {EPISODES} episodes of {FRAMES} frames …");
    let episodes: Vec<_> = (0..EPISODES as u64).map(episode).collect();
    make(&dir.path().join("recording"), &episodes);
    eprintln!("making a policy of the profile {profile} …");
    let policy = dir.path().join("policy.safetensors");
    run(&["policy", profile], &policy, &[])?;
    run(&["measure", profile], dir.path(), options)
}

/// Runs this program as a process of its own.
fn run(words: &[&str], path: &Path, more: &[String]) -> Result<()> {
    let mut command = Command::new(std::env::current_exe()?);
    let status = command.args(words).arg(path).args(more).status()?;
    match status.success() {
        true => Ok(()),
        false => Err(format!("{words:?} ended with {status}").into()),
    }
}

fn write_policy(profile: Profile, path: &Path) -> Result<()> {
    let file = PolicyFile::hashing_words(init_policy(&profile.config(), 1)?);
    policy_file::save(&file.policy, &file.tokenizer, None, path)?;
    Ok(())
}

fn measure(work: &Work, dir: &Path) -> Result<()> {
    let name = work.profile.name();
    let policy = dir.join("policy.safetensors");
    let cache = DiskCache::open(&dir.join("prefix-cache"), CACHE_BYTES)?;
    let begin = Instant::now();
    let mut phase = Phases { begin, name };
    let recording = OpenRecording::open(&dir.join("recording"), &policy, Some(&cache))?;
    phase.done("the recording is open");
    let maker = recording.maker();
    let samples = recording.samples(&maker);
    let spec = EvalSpec::new(dims(recording.config())?);
    let by = EvaluationSetSpec {
        network: NETWORK,
        mode: Mode::Direct,
        frames: work.drawn,
        secret: RegistrationSecret::new([3; 32]),
    };
    let folder = dir.join("evaluation-set");
    let set = EvaluationSet::prepare(&recording, &samples, &spec, by, &folder)?;
    let (registration, list) = set.registration(NODE);
    check_leaf_list(&registration, &list)?;
    phase.done("the evaluation set is prepared, and its registration is valid");

    let base = base(&policy)?;
    let options = TrainOptions {
        steps: work.steps,
        batch_size: work.batch,
        ..TrainOptions::default()
    };
    let all = TrainingSamples::Prepared(&samples);
    let config = recording.config();
    let trained = train_on(
        &Device::Cpu,
        config,
        &base,
        all,
        &options,
        None,
        &mut |_| (),
    )?;
    samples.rest();
    phase.done("it is trained");

    let expected = expected(&set, &spec, work.evaluated);
    let base = quantise_weights(&spec, &base)?;
    let update = quantise_weights(&spec, &trained.weights)?;
    let input = set.private_input(&samples, &expected, base, update)?;
    let indices = sample_indices(
        &expected.terms.challenge,
        set.commitment.samples,
        work.evaluated,
    )?;
    let opened = input.places();
    assert!(opened.iter().map(|(index, _)| *index).eq(indices));
    phase.done("the private input is made");

    // What all samples would take: in float32 as the cache's entries have them, and in fixed point.
    let (own, count) = (bytes_in(&folder)?, fs::read_dir(&folder)?.count() as u64);
    let one = samples.sample(0)?;
    let values = |layers: &[Vec<f32>]| layers.iter().map(Vec::len).sum::<usize>();
    let floats = 4 * (values(&one.keys) + values(&one.values) + one.actions.len()) as u64;
    let everything = recording.len() as u64 * (floats + own / count);
    let line = |bench: &str, ours: u64| {
        let line = serde_json::json!({
            "bench": format!("{bench}_{name}"),
            "ours": ours as f64 / GIB,
            "peer": everything as f64 / GIB,
            "ratio": everything as f64 / ours as f64,
            "unit": "GiB",
            "frames": recording.len(),
            "drawn": work.drawn,
            "trained_samples": work.steps * work.batch,
        });
        println!("{line}");
    };
    let frames = u64::from(Rules::default().evaluation_frames);
    line("recording_peak_memory", peak()?);
    line("recording_disk", own + cache.bytes());
    // The cache grows up to its budget. What 512 samples take is computed where fewer were made.
    let whole = own / count * frames + CACHE_BYTES;
    line("recording_disk_at_most", whole);
    Ok(())
}

/// States how far a measurement is, and how much memory it has taken so far.
struct Phases<'a> {
    begin: Instant,
    name: &'a str,
}

impl Phases<'_> {
    fn done(&mut self, what: &str) {
        let seconds = self.begin.elapsed().as_secs();
        let peak = peak().unwrap_or_default() as f64 / GIB;
        eprintln!(
            "{}: {what} after {seconds} s; the peak of memory is {peak:.2} GiB",
            self.name
        );
    }
}

/// The expert of a policy file. The rest of the file is not kept.
fn base(policy: &Path) -> Result<ExpertWeights> {
    Ok(policy_file::load(policy)?.policy.expert)
}

fn expected(set: &EvaluationSet, spec: &EvalSpec, count: u32) -> ExpectedClaim {
    ExpectedClaim {
        terms: Terms {
            network: NETWORK,
            round: 0,
            node: NODE,
            dataset: set.commitment,
            evaluation: spec.digest(),
            base: WeightsDigest::default(),
            update: WeightsDigest::default(),
            challenge: Digest([9; 32]),
            eval_samples: count,
            test: TTest {
                min_improvement_bps: 1,
                confidence: Confidence::P99,
            },
        },
        disclosure: Disclosure::Losses,
    }
}

/// Bytes of the files in a folder.
fn bytes_in(folder: &Path) -> Result<u64> {
    let mut bytes = 0;
    for file in fs::read_dir(folder)? {
        bytes += file?.metadata()?.len();
    }
    Ok(bytes)
}

/// The most memory that this process has had, in bytes.
fn peak() -> Result<u64> {
    let status = fs::read_to_string("/proc/self/status")?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
    let kilobytes = line.ok_or("no VmHWM in /proc/self/status")?;
    Ok(1024 * kilobytes.trim().trim_end_matches(" kB").parse::<u64>()?)
}
