//! The options for the cache of prepared samples.

use anyhow::{bail, ensure, Context, Result};
use std::env;
use std::path::{Path, PathBuf};
use zk0_smolvla::frames::prefix_cache::{CacheError, DiskCache};

/// In gigabytes.
const DEFAULT_BUDGET: f64 = 20.0;

/// In gigabytes. With an evaluation set of 512 samples it takes less than 4 GiB.
const NODE_BUDGET: f64 = 2.0;

/// Where prepared samples are kept.
#[derive(Clone, Debug, clap::Args)]
pub struct CacheOptions {
    /// Keep prepared samples in this folder, the prefix cache. Several runs may share it [default: zk0/prefix in your cache folder; for a node, prefix-cache in its state folder]
    #[arg(long, value_name = "DIR", conflicts_with = "no_cache")]
    cache: Option<PathBuf>,
    /// Use at most this many gigabytes for the prefix cache. A frame takes 7.3 MB at the published size. What does not fit is computed
    /// whenever it is needed [default: 20; for a node, 2]
    #[arg(long, value_name = "GB", value_parser = gigabytes)]
    cache_budget: Option<f64>,
    /// Use no prefix cache. All samples are kept in memory; a node computes each sample whenever it needs it.
    #[arg(long)]
    no_cache: bool,
}

impl CacheOptions {
    /// Opens the cache, by default the user's own; `None` if turned off.
    pub fn open(&self) -> Result<Option<DiskCache>> {
        self.open_or(DEFAULT_BUDGET, default_folder)
    }

    /// As [`Self::open`], for a node: by default smaller, and in the state folder.
    pub fn open_in(&self, state: &Path) -> Result<Option<DiskCache>> {
        self.open_or(NODE_BUDGET, || Ok(state.join("prefix-cache")))
    }

    fn open_or(
        &self,
        budget: f64,
        default: impl FnOnce() -> Result<PathBuf>,
    ) -> Result<Option<DiskCache>> {
        if self.no_cache {
            return Ok(None);
        }
        let budget = self.cache_budget.unwrap_or(budget);
        let folder = match &self.cache {
            Some(folder) => folder.clone(),
            None => default()?,
        };
        let cache = DiskCache::open(&folder, (budget * 1e9) as u64);
        cache
            .context("the prefix cache cannot be opened; --cache DIR chooses another folder, and --no-cache uses none")
            .map(Some)
    }
}

fn gigabytes(text: &str) -> Result<f64> {
    let budget: f64 = text.parse()?;
    ensure!(
        budget >= 0.0 && budget.is_finite(),
        "it has to be a number of gigabytes, 0 or more"
    );
    Ok(budget)
}

fn default_folder() -> Result<PathBuf> {
    let set = |name| env::var_os(name).filter(|value| !value.is_empty());
    let folder = set("XDG_CACHE_HOME").map(PathBuf::from);
    match folder.or_else(|| Some(Path::new(&set("HOME")?).join(".cache"))) {
        Some(folder) => Ok(folder.join("zk0/prefix")),
        None => bail!(
            "neither XDG_CACHE_HOME nor HOME is set: choose a folder for the prefix cache with --cache DIR"
        ),
    }
}

/// Adds advice to an error of the cache.
pub fn cache_failed(error: CacheError) -> anyhow::Error {
    match error {
        CacheError::Prepare(error) => error.into(),
        error => anyhow::Error::from(error)
            .context("the prefix cache failed; --no-cache keeps the samples in memory instead"),
    }
}
