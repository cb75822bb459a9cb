//! Files that one start leaves for the next, on a disk that may damage them: the prefix cache, and the snapshots of a training run.

use std::fs;
use std::path::Path;

use sha2::{Digest, Sha256};
use zk0_lerobot::config::PolicyConfig;
use zk0_smolvla::frames::batch::SamplesInMemory;
use zk0_smolvla::frames::prefix_cache::entry::{decode, encode};
use zk0_smolvla::frames::prefix_cache::{CacheKey, FileDigests};
use zk0_smolvla::frames::sample::{ObservedSample, PreparedSample};
use zk0_smolvla::policy::init::init_policy;
use zk0_smolvla::policy::profile::Profile as Model;
use zk0_smolvla::policy::weights::Policy;
use zk0_smolvla::train::snapshots::{RunIdentity, SnapshotError, Snapshots};
use zk0_smolvla::train::{TrainOptions, Trainer, TrainingSamples};
use zk0_testkit::fuzzing::Target;

fn config() -> PolicyConfig {
    Model::Micro.config()
}

fn sample() -> PreparedSample {
    let c = config();
    let tokens = 2;
    let layers = vec![vec![0.5; tokens * c.kv_width()]; c.text.layers];
    PreparedSample {
        prefix_tokens: tokens,
        keys: layers.clone(),
        values: layers,
        actions: vec![0.25; c.chunk_elements()],
        is_pad: vec![false; c.chunk_size],
    }
}

/// Reads an entry of the cache. If the input does not begin like an entry, it is the part that follows a correct header.
pub fn prefix_entry() -> Target {
    const HEADER: usize = 80;
    let key = CacheKey([7; 32]);
    let whole = encode(&key, &sample());
    let observed = ObservedSample {
        observed: sample(),
        state: vec![0.25],
    };
    let start = whole[..40].to_vec();
    let seeds = vec![
        whole.clone(),
        whole[HEADER..].to_vec(),
        encode(&key, &observed)[HEADER..].to_vec(),
    ];
    Target {
        seeds,
        run: Box::new(move |bytes| {
            let is_whole = bytes.starts_with(&start[..8]);
            let entry = match is_whole {
                true => bytes.to_vec(),
                false => {
                    let length = (bytes.len() as u64).to_le_bytes();
                    [&start, &length[..], &Sha256::digest(bytes)[..], bytes].concat()
                }
            };
            match decode::<PreparedSample>(&key, &entry, false) {
                Err(why) if why.contains("kind `observed`") => {
                    decode::<ObservedSample>(&key, &entry, false).map(drop)
                }
                Err(why) if why.contains("of kind `") => Err("another kind".into()),
                read => read.map(drop),
            }
        }),
    }
}

/// Reads the digests of files, and asks for one of them. The reader believes the digests, so a made-up digest shows that they were
/// read.
pub fn file_digests() -> Target {
    let dir = tempfile::tempdir().unwrap();
    let (file, memo) = (dir.path().join("video"), dir.path().join("files.json"));
    fs::write(&file, b"video").unwrap();
    let mut digests = FileDigests::load(&memo);
    let computed = digests.of(&file).unwrap();
    digests.save(&memo).unwrap();
    let pretended = [9; 32];
    let seed = fs::read_to_string(&memo).unwrap();
    let seed = seed.replace(&hex::encode(computed), &hex::encode(pretended));
    // The file's path and time differ in the next run, so the inputs hold these words in their place.
    let here = fs::canonicalize(&file).unwrap();
    let here = here.to_str().unwrap().to_owned();
    let modified = fs::metadata(&file).unwrap().modified().unwrap();
    let time = modified.duration_since(std::time::UNIX_EPOCH).unwrap();
    let time = time.as_nanos().to_string();
    let seed = seed.replace(&here, "HERE").replace(&time, "NOW");
    Target {
        seeds: vec![seed.into_bytes()],
        run: Box::new(move |bytes| {
            let _ = &dir;
            let text = String::from_utf8_lossy(bytes);
            let text = text.replace("HERE", &here).replace("NOW", &time);
            fs::write(&memo, text).unwrap();
            match FileDigests::load(&memo).of(&file) {
                Ok(digest) if digest == pretended => Ok(()),
                Ok(digest) if digest == computed => Err("computed again".into()),
                Ok(_) => Err("another digest".into()),
                Err(error) => panic!("{error}"),
            }
        }),
    }
}

/// A run that was stopped after a step.
struct Run {
    dir: tempfile::TempDir,
    policy: Policy,
    samples: &'static SamplesInMemory<'static, PreparedSample>,
}

const STATE: &str = "000001/state.json";
const FILES: [&str; 2] = ["weights.safetensors", "moments.safetensors"];

impl Run {
    fn stopped() -> Self {
        let samples: &[PreparedSample] = Box::leak(Box::new([sample()]));
        let run = Self {
            dir: tempfile::tempdir().unwrap(),
            policy: init_policy(&config(), 7).unwrap(),
            samples: Box::leak(Box::new(SamplesInMemory::new(&config(), samples).unwrap())),
        };
        let mut trainer = run.trainer();
        let snapshots = run.snapshots(&trainer);
        trainer.step().unwrap();
        snapshots.save(&trainer).unwrap();
        run
    }

    fn trainer(&self) -> Trainer<'static> {
        let options = TrainOptions {
            steps: 2,
            batch_size: 1,
            ..TrainOptions::default()
        };
        let samples = TrainingSamples::Prepared(self.samples);
        Trainer::new(&config(), &self.policy.expert, samples, options).unwrap()
    }

    fn snapshots(&self, trainer: &Trainer) -> Snapshots {
        let identity = RunIdentity::of(trainer, &[1; 32]).unwrap();
        Snapshots::new(self.dir.path(), 2, identity).unwrap()
    }

    fn file(&self, name: &str) -> Vec<u8> {
        fs::read(self.dir.path().join(name)).unwrap()
    }

    /// Lets the next start read what is there now.
    fn resume(&self) -> Result<(), String> {
        let mut trainer = self.trainer();
        match self.snapshots(&trainer).resume(&mut trainer) {
            Ok(Some(_)) => Ok(()),
            // The run goes on from an earlier snapshot if there is one, and its log states why.
            Ok(None) => Err("damaged".into()),
            Err(SnapshotError::OtherRun { what, .. }) => Err(format!("another {what}")),
            Err(error) => Err(error.to_string().replace(path(self.dir.path()), "")),
        }
    }
}

fn path(path: &Path) -> &str {
    path.to_str().unwrap()
}

pub fn training_state() -> Target {
    let run = Run::stopped();
    Target {
        seeds: vec![run.file(STATE)],
        run: Box::new(move |bytes| {
            fs::write(run.dir.path().join(STATE), bytes).unwrap();
            run.resume()
        }),
    }
}

/// Reads one of the two files of tensors, which the first byte chooses. Its digest is made correct.
pub fn training_tensors() -> Target {
    let run = Run::stopped();
    let whole = FILES.map(|name| run.file(&format!("000001/{name}")));
    let state: serde_json::Value = serde_json::from_slice(&run.file(STATE)).unwrap();
    let seeds = [0, 1].map(|at: u8| [&[at][..], &whole[usize::from(at)]].concat());
    Target {
        seeds: seeds.into(),
        run: Box::new(move |bytes| {
            let (which, bytes) = bytes.split_first().ok_or("no bytes at all")?;
            let which = usize::from(*which) % 2;
            let mut state = state.clone();
            state["files"][FILES[which]] = serde_json::json!({
                "sha256": hex::encode(Sha256::digest(bytes)),
                "bytes": bytes.len(),
            });
            let write = |name: &str, bytes: &[u8]| {
                fs::write(run.dir.path().join("000001").join(name), bytes).unwrap()
            };
            write(FILES[which], bytes);
            write(FILES[1 - which], &whole[1 - which]);
            write("state.json", state.to_string().as_bytes());
            run.resume()
        }),
    }
}
