//! A comparison on disk: a file for each run and trial. No file is written twice, so interruptions change no results.

use anyhow::{bail, Context, Result};
use serde::de::DeserializeOwned;
use serde::Serialize;
use std::fs;
use std::path::{Path, PathBuf};
use zk0_circuits::Digest;
use zk0_files::{atomic_file, bounded_file};
use zk0_simulate::compare::run::Run;
use zk0_simulate::compare::search::Trial;
use zk0_simulate::compare::variant::{Variant, VariantKind};

/// A hundred thousand nodes take tens of megabytes.
const MAX_BYTES: u64 = 256 << 20;

/// The folder of a comparison.
pub struct ComparisonFolder<'a>(&'a Path);

impl<'a> ComparisonFolder<'a> {
    /// Begins or resumes a comparison in `out`. `of` identifies its policy, recordings and options.
    pub fn open(out: &'a Path, of: Digest, resume: bool) -> Result<Self> {
        for folder in ["runs", "trials"] {
            let folder = out.join(folder);
            fs::create_dir_all(&folder)
                .with_context(|| format!("creating {}", folder.display()))?;
        }
        let path = out.join("comparison");
        if !path.exists() {
            write(&path, of.to_string().as_bytes())?;
            return Ok(Self(out));
        }
        if !resume {
            bail!(
                "{} holds a comparison: add --resume to go on with it, or choose another --out",
                out.display()
            );
        }
        let before = bounded_file::read(&path, 1 << 10);
        let before = before.with_context(|| format!("reading {}", path.display()))?;
        if before != of.to_string().as_bytes() {
            bail!(
                "{} is a comparison with another policy, other recordings or other options: go on with those, or choose another --out",
                path.display()
            );
        }
        Ok(Self(out))
    }

    fn run_path(&self, variant: Variant, seed: u64) -> PathBuf {
        let name = match variant {
            Variant::Federated => "federated".into(),
            Variant::Centralised => "centralised".into(),
            Variant::Alone(node) => format!("node-{}-alone", node + 1),
        };
        self.0.join(format!("runs/seed-{seed}-{name}.json"))
    }

    fn trial_path(&self, kind: VariantKind, number: u64) -> PathBuf {
        self.0
            .join(format!("trials/{}-{}.json", kind.name(), number + 1))
    }

    /// Whether a run is done.
    pub fn has_run(&self, variant: Variant, seed: u64) -> bool {
        self.run_path(variant, seed).exists()
    }

    /// Writes a run to disk.
    pub fn keep_run(&self, run: &Run) -> Result<()> {
        write_json(&self.run_path(run.variant, run.seed), run)
    }

    /// A run that is done.
    pub fn run(&self, variant: Variant, seed: u64) -> Result<Run> {
        read(&self.run_path(variant, seed))
    }

    /// Trials of each kind, if the search has ended.
    pub fn searched(&self) -> Result<Option<u64>> {
        let path = self.0.join("trials/ended.json");
        path.exists().then(|| read(&path)).transpose()
    }

    /// Records that the search ended after these trials of each kind.
    pub fn keep_searched(&self, trials: u64) -> Result<()> {
        write_json(&self.0.join("trials/ended.json"), &trials)
    }

    /// Whether a trial is done.
    pub fn has_trial(&self, kind: VariantKind, number: u64) -> bool {
        self.trial_path(kind, number).exists()
    }

    /// Writes a trial to disk.
    pub fn keep_trial(&self, number: u64, trial: &Trial) -> Result<()> {
        write_json(&self.trial_path(trial.kind, number), trial)
    }

    /// The first trials of a kind.
    pub fn trials(&self, kind: VariantKind, count: u64) -> Result<Vec<Trial>> {
        (0..count)
            .map(|number| read(&self.trial_path(kind, number)))
            .collect()
    }
}

fn write(path: &Path, bytes: &[u8]) -> Result<()> {
    atomic_file::replace(path, bytes).with_context(|| format!("writing {}", path.display()))
}

/// Writes JSON, whole or not at all.
pub fn write_json(path: &Path, value: &impl Serialize) -> Result<()> {
    write(path, &serde_json::to_vec_pretty(value)?)
}

fn read<T: DeserializeOwned>(path: &Path) -> Result<T> {
    let read = bounded_file::read(path, MAX_BYTES).map_err(anyhow::Error::from);
    let value = read.and_then(|bytes| Ok(serde_json::from_slice(&bytes)?));
    value.with_context(|| format!("reading {}", path.display()))
}
