//! Frames of recordings as samples, for `zk0 train` and `zk0 eval`: through the prefix cache, or in memory.

use anyhow::{bail, Context, Result};
use std::{
    borrow::Cow,
    env,
    path::{Path, PathBuf},
};
use zk0_lerobot::{dataset::Dataset, tokenizer::Tokenizer};
use zk0_node::progress::Progress;
use zk0_smolvla::{
    frames::{
        batch::SampleSource,
        prefix_cache::{
            entry::Entry, CacheError, DiskCache, FileDigests, FrameMaker, FrameRef, FrameSource,
            KeySpace,
        },
        sample::{FromFrame, ObservedSample, PreparedSample},
    },
    train::Samples,
    PolicyConfig, PolicyError,
};

/// Where prepared samples are kept.
#[derive(Clone, Debug, clap::Args)]
pub struct CacheOptions {
    /// The prefix cache's folder; several runs may share it [default: zk0/prefix in the user's cache folder; of a node, prefix-cache in its state]
    #[arg(long, value_name = "DIR", conflicts_with = "no_cache")]
    cache: Option<PathBuf>,
    /// Gigabytes that the cache may take. A frame takes 7.3 MB at the published size.
    #[arg(long, value_name = "GB", default_value_t = 20.0)]
    cache_budget: f64,
    /// Keep all samples in memory instead.
    #[arg(long)]
    no_cache: bool,
}

impl CacheOptions {
    /// Opens the cache, by default the user's, unless there is to be none.
    pub fn open(&self) -> Result<Option<DiskCache>> {
        self.open_or(default_folder)
    }

    /// As [`Self::open`], by default in another folder.
    pub fn open_or(&self, default: impl FnOnce() -> Result<PathBuf>) -> Result<Option<DiskCache>> {
        if self.no_cache {
            return Ok(None);
        }
        if !(self.cache_budget >= 0.0 && self.cache_budget.is_finite()) {
            bail!("--cache-budget {}: gigabytes, 0 or more", self.cache_budget);
        }
        let folder = match &self.cache {
            Some(folder) => folder.clone(),
            None => default()?,
        };
        let cache = DiskCache::open(&folder, (self.cache_budget * 1e9) as u64);
        cache
            .context("--cache names another folder, --no-cache does without")
            .map(Some)
    }
}

fn default_folder() -> Result<PathBuf> {
    let set = |name| env::var_os(name).filter(|value| !value.is_empty());
    let folder = set("XDG_CACHE_HOME").map(PathBuf::from);
    match folder.or_else(|| Some(Path::new(&set("HOME")?).join(".cache"))) {
        Some(folder) => Ok(folder.join("zk0/prefix")),
        None => bail!(
            "neither XDG_CACHE_HOME nor HOME is set: say where the prefix cache goes by --cache"
        ),
    }
}

/// Kinds of samples, which say what is trained on them.
pub trait Kind: FromFrame + Entry {
    /// A source of them, as training takes it.
    fn samples(source: &dyn SampleSource<Self>) -> Samples<'_>;
}

impl Kind for PreparedSample {
    fn samples(source: &dyn SampleSource<Self>) -> Samples<'_> {
        Samples::Prepared(source)
    }
}

impl Kind for ObservedSample {
    fn samples(source: &dyn SampleSource<Self>) -> Samples<'_> {
        Samples::Observed(source)
    }
}

/// Names frames of one of several recordings.
pub struct Naming<'a> {
    space: KeySpace,
    config: &'a PolicyConfig,
    tokenizer: &'a dyn Tokenizer,
    cache: Option<&'a DiskCache>,
    files: FileDigests,
}

impl<'a> Naming<'a> {
    /// For frames in `space`; the digests of videos are remembered in the cache.
    pub fn new(
        space: KeySpace,
        config: &'a PolicyConfig,
        tokenizer: &'a dyn Tokenizer,
        cache: Option<&'a DiskCache>,
    ) -> Self {
        Self {
            space,
            config,
            tokenizer,
            cache,
            files: cache.map(DiskCache::file_digests).unwrap_or_default(),
        }
    }

    /// Frames `indices` of `dataset`, which is number `number`.
    pub fn frames(
        &mut self,
        number: usize,
        dataset: &Dataset,
        indices: &[usize],
    ) -> Result<Vec<FrameRef>> {
        let (config, files) = (self.config, &mut self.files);
        let keys = self
            .space
            .keys(config, self.tokenizer, dataset, indices, files);
        let keys = keys.with_context(|| format!("recording {}", dataset.root().display()))?;
        if let Some(cache) = self.cache {
            cache.remember(&mut self.files)?;
        }
        let frames = keys.into_iter().zip(indices);
        Ok(frames
            .map(|(key, index)| FrameRef {
                dataset: number,
                index: *index,
                key,
            })
            .collect())
    }
}

/// Samples ready for use.
pub enum Ready<'c, 'a, S> {
    /// Read from the cache one at a time.
    Cached(FrameSource<'c, 'a, S>),
    /// All of them.
    InMemory(Vec<S>),
}

impl<'c, 'a, S: Kind> Ready<'c, 'a, S> {
    /// Makes what is not in the cache yet, or all where there is none.
    pub fn prepare(
        cache: Option<&'c DiskCache>,
        maker: &'c FrameMaker<'a>,
        frames: Vec<FrameRef>,
    ) -> Result<Self> {
        let mut progress = Progress::start("preparing samples", frames.len() as u64);
        let Some(cache) = cache else {
            let mut samples = Vec::with_capacity(frames.len());
            for frame in &frames {
                samples.push(maker.make(frame)?);
                progress.reached(samples.len() as u64);
            }
            maker.rest();
            return Ok(Self::InMemory(samples));
        };
        let source = FrameSource::new(cache, maker, frames);
        let filled = match source.fill(|done, _| progress.reached(done as u64)) {
            Ok(filled) => filled,
            Err(CacheError::Prepare(error)) => return Err(error.into()),
            Err(error) => return Err(error).context("--no-cache keeps samples in memory instead"),
        };
        tracing::info!(
            "{} samples from the prefix cache, {} made anew ({})",
            filled.found,
            filled.made,
            cache.root().display()
        );
        if filled.beyond > 0 {
            tracing::warn!(
                "{} samples do not fit the cache and are computed whenever they are needed: a larger --cache-budget is faster",
                filled.beyond
            );
        }
        Ok(Self::Cached(source))
    }
}

impl<S: Kind> SampleSource<S> for Ready<'_, '_, S> {
    fn len(&self) -> usize {
        match self {
            Self::Cached(source) => source.len(),
            Self::InMemory(samples) => samples.len(),
        }
    }

    fn sample(&self, index: usize) -> std::result::Result<Cow<'_, S>, PolicyError> {
        match self {
            Self::Cached(source) => source.sample(index),
            Self::InMemory(samples) => match samples.get(index) {
                Some(sample) => Ok(Cow::Borrowed(sample)),
                None => Err(PolicyError::Sample(format!(
                    "there is no sample {index} among {}",
                    samples.len()
                ))),
            },
        }
    }
}
