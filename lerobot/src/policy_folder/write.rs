//! Writes a policy folder: a copy of the opened one with other weights.

use std::borrow::Cow;
use std::cmp::Reverse;
use std::collections::{BTreeMap, BTreeSet};
use std::fs::{self, File};
use std::io::{self, Write};
use std::path::Path;

use crate::dataset::Stats;
use crate::error::{Result, StoredPolicyError};
use crate::layout::policy_layout;
use crate::policy_folder::adapter::ADAPTER_FILES;
use crate::policy_folder::folder::{PolicyFolder, CONFIG, VLM_CONFIG, WEIGHTS};
use crate::policy_folder::json_file::read_json;
use crate::policy_folder::other_statistics::OtherStats;
use zk0_files::atomic_file::{self, Durability};
use zk0_tensors::{
    check_finite, encode, Dtype, TensorData, TensorError, TensorHeader, TensorInfo, TensorSet,
    BLOCK,
};

/// Type of changed tensors.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Precision {
    /// Each in the source's type, rounded to nearest even.
    Kept,
    /// F32: keeps all that training changed, in a larger file.
    Single,
}

impl PolicyFolder {
    /// Writes a policy folder to the new or empty folder `to`. Tensors in `changed` replace those of the same names. All other tensors,
    /// metadata and files are copied byte for byte; folders are left out.
    ///
    /// The weights come last, and get their name when complete.
    ///
    /// # Errors
    /// [`StoredPolicyError::AtPath`] when a file cannot be read or written, `to` is not empty, or a tensor in `changed` does not fit the
    /// policy, is not finite, or is too large for the kept type.
    pub fn write(&self, to: &Path, changed: &TensorSet, precision: Precision) -> Result<()> {
        self.write_copy(to, changed, &OtherStats::default(), precision)
    }

    /// [`Self::write`] for weights trained with the statistics `stats`, which replace the source's. If it has none, they go into its
    /// processors' state or, without processors, among the weights as in LeRobot 0.3.
    ///
    /// # Errors
    /// As [`Self::write`]; and when the source's normalisation is not implemented, `stats` have other dimensions, or a processor's file is
    /// not LeRobot's.
    pub fn write_trained(
        &self,
        to: &Path,
        changed: &TensorSet,
        stats: &Stats,
        precision: Precision,
    ) -> Result<()> {
        self.write_copy(to, changed, &self.other_stats(stats)?, precision)
    }

    fn write_copy(
        &self,
        to: &Path,
        changed: &TensorSet,
        stats: &OtherStats,
        precision: Precision,
    ) -> Result<()> {
        self.check_changed(changed)?;
        let failed = |path: &Path| {
            let path = path.to_path_buf();
            move |e: io::Error| StoredPolicyError::file(&path, e)
        };
        fs::create_dir_all(to).map_err(failed(to))?;
        if fs::read_dir(to).map_err(failed(to))?.next().is_some() {
            return Err(StoredPolicyError::file(
                to,
                "is not empty; a policy folder is written to a new folder",
            ));
        }
        for name in self.other_files()? {
            if name
                .to_str()
                .is_some_and(|name| stats.files.contains_key(name))
            {
                continue;
            }
            let (source, target) = (self.folder.join(&name), to.join(&name));
            let mut source = File::open(&source).map_err(failed(&source))?;
            atomic_file::write(&target, Durability::OnDisk, |out| {
                io::copy(&mut source, out)
            })
            .map_err(failed(&target))?;
        }
        for (name, content) in stats.files.iter().chain(&self.whole()?) {
            let target = to.join(name);
            atomic_file::replace(&target, content).map_err(failed(&target))?;
        }
        let weights = NewWeights {
            source: self,
            changed,
            stats: &stats.tensors,
            precision,
        };
        weights.write(&to.join(WEIGHTS))
    }

    /// The files that make an adapter's folder a whole policy's.
    fn whole(&self) -> Result<BTreeMap<String, Vec<u8>>> {
        let mut files = BTreeMap::new();
        if self.adapter.is_some() {
            // The features' order counts, so only this text is changed.
            let config = read_json(&self.folder.join(CONFIG))?;
            let config = config.replace("\"use_peft\": true", "\"use_peft\": false");
            files.insert(CONFIG.into(), config.into_bytes());
            let vlm = self.weights.path().with_file_name(VLM_CONFIG);
            if vlm.exists() && !self.folder.join(VLM_CONFIG).exists() {
                files.insert(VLM_CONFIG.into(), read_json(&vlm)?.into_bytes());
            }
        }
        Ok(files)
    }

    fn other_files(&self) -> Result<BTreeSet<std::ffi::OsString>> {
        let failed = |e: io::Error| StoredPolicyError::file(&self.folder, e);
        let mut names = BTreeSet::new();
        for entry in fs::read_dir(&self.folder).map_err(failed)? {
            let entry = entry.map_err(failed)?;
            // Follows links: snapshots in the Hub's cache consist of them.
            let is_file = fs::metadata(entry.path()).is_ok_and(|about| about.is_file());
            let name = entry.file_name();
            let is_weights = name == WEIGHTS || ADAPTER_FILES.iter().any(|file| name == *file);
            if is_file && !is_weights {
                names.insert(name);
            }
        }
        Ok(names)
    }

    fn check_changed(&self, changed: &TensorSet) -> Result<()> {
        let layout = policy_layout(&self.config.dims);
        for (name, tensor) in changed {
            let Some(shape) = layout.get(name) else {
                return Err(TensorError::Unexpected(name.clone()).into());
            };
            tensor.check_shape(name, shape)?;
            check_finite(name, &tensor.data)?;
            if self.weights.info(name).is_none() {
                return Err(StoredPolicyError::file(
                    self.weights.path(),
                    format!("tensor `{name}` is stored under another name, which would change too"),
                ));
            }
        }
        Ok(())
    }
}

enum WriteFailure {
    Weights(StoredPolicyError),
    Writing(io::Error),
}

impl From<StoredPolicyError> for WriteFailure {
    fn from(error: StoredPolicyError) -> Self {
        Self::Weights(error)
    }
}

impl From<io::Error> for WriteFailure {
    fn from(error: io::Error) -> Self {
        Self::Writing(error)
    }
}

struct NewWeights<'a> {
    source: &'a PolicyFolder,
    changed: &'a TensorSet,
    /// Statistics, always in F32: a standard deviation must not be rounded.
    stats: &'a TensorSet,
    precision: Precision,
}

impl NewWeights<'_> {
    fn write(&self, path: &Path) -> Result<()> {
        // The atomic writer carries only file errors; errors of weights go around it.
        let mut wrong = None;
        let written = atomic_file::write(path, Durability::OnDisk, |out| {
            self.write_to(out).map_err(|error| match error {
                WriteFailure::Writing(error) => error,
                WriteFailure::Weights(error) => {
                    wrong = Some(error);
                    io::Error::from(io::ErrorKind::InvalidData)
                }
            })
        });
        match (written, wrong) {
            (Ok(()), _) => Ok(()),
            (Err(_), Some(error)) => Err(error.within(path)),
            (Err(error), None) => Err(StoredPolicyError::file(path, error)),
        }
    }

    fn write_to(&self, out: &mut dyn Write) -> std::result::Result<(), WriteFailure> {
        let source = &self.source.weights;
        let header = self.other_header();
        let bytes = match &header {
            // No byte differs, not even order or spacing.
            None => source.header().to_vec(),
            Some(header) => header.to_bytes()?,
        };
        out.write_all(&(bytes.len() as u64).to_le_bytes())?;
        out.write_all(&bytes)?;

        let entries: Vec<(String, Option<Dtype>)> = match &header {
            None => source.names().into_iter().map(|n| (n, None)).collect(),
            Some(header) => {
                let typed = |(name, info): (&str, &TensorInfo)| (name.into(), Some(info.dtype));
                header.tensors().map(typed).collect()
            }
        };
        for (name, dtype) in entries {
            let info = source.info(&name);
            match self.replacement(&name) {
                Some(tensor) => {
                    let tensor = tensor?;
                    let dtype = dtype.or(info.map(|i| i.dtype)).unwrap_or(Dtype::F32);
                    for block in tensor.data.chunks(BLOCK / 4) {
                        let bytes =
                            encode(dtype, block).ok_or_else(|| StoredPolicyError::TooLarge {
                                name: name.clone(),
                                dtype: dtype.to_string(),
                            })?;
                        out.write_all(&bytes)?;
                    }
                }
                None => {
                    for block in source.blocks(&name)? {
                        out.write_all(&block?)?;
                    }
                }
            }
        }
        Ok(())
    }

    /// What replaces the source's tensor of this name, if anything.
    fn replacement(&self, name: &str) -> Option<Result<Cow<'_, TensorData>>> {
        if let Some(tensor) = self.stats.get(name).or_else(|| self.changed.get(name)) {
            return Some(Ok(Cow::Borrowed(tensor)));
        }
        let adapter = self.source.adapter.as_ref();
        let is_adapted = adapter.is_some_and(|adapter| adapter.adapts(name));
        is_adapted.then(|| self.source.tensor(name).map(Cow::Owned))
    }

    /// A new header; `None` when all tensors keep their names, types and shapes.
    fn other_header(&self) -> Option<TensorHeader<'_>> {
        let source = &self.source.weights;
        let mut same = true;
        let mut tensors = Vec::new();
        for name in source.names() {
            let Some(info) = source.info(&name) else {
                continue;
            };
            if self.stats.contains_key(&name) {
                continue;
            }
            let mut dtype = info.dtype;
            if self.precision == Precision::Single && self.changed.contains_key(&name) {
                same &= dtype == Dtype::F32;
                dtype = Dtype::F32;
            }
            tensors.push((name, dtype, info.shape.clone()));
        }
        for (name, tensor) in self.stats {
            let found = source.info(name);
            same &= found.is_some_and(|i| i.dtype == Dtype::F32 && i.shape == tensor.shape);
            tensors.push((name.clone(), Dtype::F32, tensor.shape.clone()));
        }
        if same {
            return None;
        }
        // Wide types first, as in safetensors: every tensor stays aligned.
        tensors.sort_by(|(a, x, _), (b, y, _)| (Reverse(x), a).cmp(&(Reverse(y), b)));
        let metadata = source.metadata().as_ref();
        let metadata = metadata.map(|m| m.iter().map(|(k, v)| (&k[..], &v[..])).collect());
        Some(TensorHeader::new(metadata, tensors))
    }
}
