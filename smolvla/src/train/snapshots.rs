//! Snapshots of a training run on disk.
//!
//! A snapshot is a folder `STEP/` with the trained tensors (`weights.safetensors`, LeRobot's names), the optimiser's moments
//! (`moments.safetensors`) and `state.json`, which names the run and both digests.
//!
//! A folder is forced to disk under another name and renamed, so a snapshot is always whole. If the disk damages the newest later, its
//! digests show it, and the run resumes from the one before.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::{fs, io};

use candle_core::Tensor;
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};
use zk0_files::atomic_file::{self, Durability};
use zk0_tensors::{write_to, TensorEntry, TensorFile, WrittenTensors, HEADER_LIMIT};

use crate::error::PolicyError;
use crate::train::trainer::Trainer;

const VERSION: u32 = 1;
const WEIGHTS: &str = "weights.safetensors";
const MOMENTS: &str = "moments.safetensors";
const STATE: &str = "state.json";
/// Begins names of folders that are no snapshots.
const UNFINISHED: &str = ".unfinished-";
const MAX_STATE: u64 = 1 << 20;

/// Why a snapshot cannot be written or resumed from.
#[derive(Debug, thiserror::Error)]
pub enum SnapshotError {
    /// The operating system refused.
    #[error("{}: {source}", path.display())]
    Io {
        /// The path.
        path: PathBuf,
        /// The cause.
        source: io::Error,
    },
    /// Of another run.
    #[error("{} is a snapshot of another run: its {what} is {theirs}, and this run has {ours}; resume with the same options and data, or train into another folder", path.display())]
    OtherRun {
        /// The snapshot.
        path: PathBuf,
        /// What differs.
        what: &'static str,
        /// The snapshot's value.
        theirs: String,
        /// This run's value.
        ours: String,
    },
    /// The trainer's state cannot be read or restored.
    #[error(transparent)]
    Policy(#[from] PolicyError),
}

/// What makes two runs the same.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RunIdentity {
    /// SHA-256 of the first tensors.
    pub start: String,
    /// SHA-256 of the samples' names, in order.
    pub data: String,
    /// Scope and options, as JSON text.
    pub options: String,
}

impl RunIdentity {
    /// For a run before its first step, on samples with the digest `data`.
    ///
    /// # Errors
    /// The tensors cannot be read.
    pub fn of(trainer: &Trainer, data: &[u8; 32]) -> Result<Self, PolicyError> {
        let mut hash = Sha256::new();
        hash.update(b"zk0:training-start:v1\0");
        for (name, tensor) in trainer.values()? {
            hash.update((name.len() as u64).to_le_bytes());
            hash.update(name);
            hash.update((tensor.shape.len() as u64).to_le_bytes());
            for dim in &tensor.shape {
                hash.update((*dim as u64).to_le_bytes());
            }
            for values in tensor.data.chunks(1 << 14) {
                let bytes: Vec<u8> = values.iter().flat_map(|x| x.to_le_bytes()).collect();
                hash.update(bytes);
            }
        }
        let options = (trainer.scope(), trainer.options());
        Ok(Self {
            start: hex::encode(hash.finalize()),
            data: hex::encode(data),
            // Text: a number may differ after JSON.
            options: serde_json::to_string(&options)
                .map_err(|error| PolicyError::Options(error.to_string()))?,
        })
    }

    fn difference<'a>(&'a self, other: &'a Self) -> Option<(&'static str, &'a str, &'a str)> {
        [
            ("start", &self.start, &other.start),
            ("data", &self.data, &other.data),
            ("set of options", &self.options, &other.options),
        ]
        .into_iter()
        .find(|(_, ours, theirs)| ours != theirs)
        .map(|(what, ours, theirs)| (what, ours.as_str(), theirs.as_str()))
    }
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct RunState {
    version: u32,
    step: usize,
    optimizer_steps: u64,
    run: RunIdentity,
    files: BTreeMap<String, FileDigest>,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct FileDigest {
    sha256: String,
    bytes: u64,
}

/// A run's snapshots.
pub struct Snapshots {
    folder: PathBuf,
    keep: usize,
    run: RunIdentity,
}

impl Snapshots {
    /// Opens or makes `folder`, and removes unfinished snapshots. The newest `keep` (at least one) stay.
    ///
    /// # Errors
    /// The folder cannot be made or read.
    pub fn new(folder: &Path, keep: usize, run: RunIdentity) -> Result<Self, SnapshotError> {
        fs::create_dir_all(folder).map_err(at(folder))?;
        for entry in fs::read_dir(folder).map_err(at(folder))? {
            let entry = entry.map_err(at(folder))?;
            let name = entry.file_name();
            if name.to_string_lossy().starts_with(UNFINISHED) {
                fs::remove_dir_all(entry.path()).map_err(at(&entry.path()))?;
            }
        }
        Ok(Self {
            folder: folder.into(),
            keep: keep.max(1),
            run,
        })
    }

    /// Whether there are no snapshots, whole or damaged.
    ///
    /// # Errors
    /// The folder cannot be read.
    pub fn is_empty(&self) -> Result<bool, SnapshotError> {
        Ok(self.steps()?.is_empty())
    }

    /// Saves the state of `trainer`, then removes the oldest snapshots.
    ///
    /// # Errors
    /// Something cannot be written; earlier snapshots stay.
    pub fn save(&self, trainer: &Trainer) -> Result<PathBuf, SnapshotError> {
        let step = trainer.steps_done();
        let whole = self.path(step);
        let unfinished = self.folder.join(format!("{UNFINISHED}{step}"));
        fs::create_dir(&unfinished).map_err(at(&unfinished))?;

        let weights = trainer
            .values()?
            .into_iter()
            .map(|(name, tensor)| TensorEntry {
                name,
                shape: tensor.shape,
                values: Cow::Owned(tensor.data),
            });
        let weights = self.write(&unfinished, WEIGHTS, weights.collect())?;
        let moments = trainer.optimizer().moments()?;
        let moments = moments.into_iter().map(|moment| TensorEntry {
            name: moment.name,
            shape: moment.shape,
            values: moment.values,
        });
        let moments = self.write(&unfinished, MOMENTS, moments.collect())?;
        let state = RunState {
            version: VERSION,
            step,
            optimizer_steps: trainer.optimizer().steps(),
            run: self.run.clone(),
            files: [weights, moments].into_iter().collect(),
        };
        let path = unfinished.join(STATE);
        atomic_file::write(&path, Durability::OnDisk, |out| {
            Ok(serde_json::to_writer_pretty(out, &state)?)
        })
        .map_err(at(&path))?;

        // A snapshot of this step is damaged or equal.
        self.remove(step)?;
        atomic_file::rename_folder(&unfinished, &whole).map_err(at(&whole))?;

        let steps = self.steps()?;
        for old in &steps[..steps.len().saturating_sub(self.keep)] {
            self.remove(*old)?;
        }
        Ok(whole)
    }

    /// Brings `trainer`, in the state of [`RunIdentity::of`], to the newest whole snapshot, and returns its step, if any.
    ///
    /// # Errors
    /// [`SnapshotError::OtherRun`].
    pub fn resume(&self, trainer: &mut Trainer) -> Result<Option<usize>, SnapshotError> {
        for step in self.steps()?.into_iter().rev() {
            let path = self.path(step);
            match self.load(&path, step)? {
                Ok(saved) => {
                    saved.give_to(trainer)?;
                    return Ok(Some(step));
                }
                Err(why) => tracing::warn!(
                    "{} is damaged ({why}); trying the snapshot before it",
                    path.display()
                ),
            }
        }
        Ok(None)
    }

    fn load(
        &self,
        path: &Path,
        step: usize,
    ) -> Result<Result<SavedSnapshot, String>, SnapshotError> {
        let state = match read_state(&path.join(STATE)) {
            Ok(state) if state.step == step => state,
            Ok(state) => return Ok(Err(format!("{STATE} is of step {}", state.step))),
            Err(why) => return Ok(Err(why)),
        };
        if let Some((what, ours, theirs)) = self.run.difference(&state.run) {
            return Err(SnapshotError::OtherRun {
                path: path.into(),
                what,
                theirs: theirs.into(),
                ours: ours.into(),
            });
        }
        let file = |name: &str| match state.files.get(name) {
            Some(digest) => read_checked(&path.join(name), digest),
            None => Err(format!("{STATE} does not name {name}")),
        };
        Ok(file(WEIGHTS).and_then(|weights| {
            Ok(SavedSnapshot {
                step,
                optimizer_steps: state.optimizer_steps,
                weights,
                moments: file(MOMENTS)?,
            })
        }))
    }

    fn write(
        &self,
        folder: &Path,
        name: &str,
        entries: Vec<TensorEntry>,
    ) -> Result<(String, FileDigest), SnapshotError> {
        let path = folder.join(name);
        let WrittenTensors { digest, bytes } =
            atomic_file::write(&path, Durability::OnDisk, |out| {
                write_to(out, entries, BTreeMap::new())
            })
            .map_err(at(&path))?;
        let sha256 = hex::encode(digest);
        Ok((name.into(), FileDigest { sha256, bytes }))
    }

    fn path(&self, step: usize) -> PathBuf {
        self.folder.join(format!("{step:06}"))
    }

    fn steps(&self) -> Result<Vec<usize>, SnapshotError> {
        let mut steps = Vec::new();
        for entry in fs::read_dir(&self.folder).map_err(at(&self.folder))? {
            let name = entry.map_err(at(&self.folder))?.file_name();
            let step = name.to_str().and_then(|name| name.parse().ok());
            steps.extend(step.filter(|step| self.path(*step).ends_with(&name)));
        }
        steps.sort_unstable();
        Ok(steps)
    }

    /// A half removed snapshot is none.
    fn remove(&self, step: usize) -> Result<(), SnapshotError> {
        let (path, removed) = (
            self.path(step),
            self.folder.join(format!("{UNFINISHED}removed-{step}")),
        );
        match fs::rename(&path, &removed) {
            Ok(()) => fs::remove_dir_all(&removed).map_err(at(&removed)),
            Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(()),
            Err(error) => Err(at(&path)(error)),
        }
    }
}

struct SavedSnapshot {
    step: usize,
    optimizer_steps: u64,
    weights: Vec<u8>,
    moments: Vec<u8>,
}

impl SavedSnapshot {
    fn give_to(self, trainer: &mut Trainer) -> Result<(), PolicyError> {
        let weights = TensorFile::open(&self.weights[..], HEADER_LIMIT)?;
        let moments = TensorFile::open(&self.moments[..], HEADER_LIMIT)?;
        let values = |file: &TensorFile<_>, name: &str, shape: &[usize]| {
            Ok(file.read_f32(name, shape)?.finite(name)?.data)
        };
        trainer.restored(self.step, |learner, optimizer| {
            for (name, variable) in learner.variables() {
                let values = values(&weights, name, variable.dims())?;
                let tensor = Tensor::from_vec(values, variable.shape(), variable.device())?;
                variable.set(&tensor)?;
            }
            optimizer.restore(self.optimizer_steps, &mut |name, shape| {
                values(&moments, name, shape)
            })
        })
    }
}

fn read_state(path: &Path) -> Result<RunState, String> {
    let failed = |error: io::Error| format!("{STATE}: {error}");
    if fs::metadata(path).map_err(failed)?.len() > MAX_STATE {
        return Err(format!("{STATE} is larger than {MAX_STATE} bytes"));
    }
    let bytes = fs::read(path).map_err(failed)?;
    let state: RunState =
        serde_json::from_slice(&bytes).map_err(|error| format!("{STATE}: {error}"))?;
    match state.version {
        VERSION => Ok(state),
        other => Err(format!("{STATE} is of version {other}, not {VERSION}")),
    }
}

fn read_checked(path: &Path, digest: &FileDigest) -> Result<Vec<u8>, String> {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let failed = |error: io::Error| format!("{name}: {error}");
    let size = fs::metadata(path).map_err(failed)?.len();
    if size != digest.bytes {
        return Err(format!("{name} has {size} bytes, not {}", digest.bytes));
    }
    let bytes = fs::read(path).map_err(failed)?;
    if hex::encode(Sha256::digest(&bytes)) == digest.sha256 {
        Ok(bytes)
    } else {
        Err(format!("{name} has another SHA-256 than {STATE} states"))
    }
}

fn at(path: &Path) -> impl Fn(io::Error) -> SnapshotError + '_ {
    move |source| SnapshotError::Io {
        path: path.into(),
        source,
    }
}
