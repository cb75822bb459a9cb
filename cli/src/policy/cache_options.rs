//! The options that say where prepared samples are kept.

use anyhow::{bail, Context, Result};
use std::env;
use std::path::{Path, PathBuf};
use zk0_smolvla::frames::prefix_cache::{CacheError, DiskCache};

/// Where prepared samples are kept.
#[derive(Clone, Debug, clap::Args)]
pub struct CacheOptions {
    /// Keep prepared samples in this folder, the prefix cache. Several runs may share it [default: zk0/prefix in your cache folder; for a node, prefix-cache in its state folder]
    #[arg(long, value_name = "DIR", conflicts_with = "no_cache")]
    cache: Option<PathBuf>,
    /// Use at most this many gigabytes for the prefix cache. A frame takes 7.3 MB at the published size.
    #[arg(long, value_name = "GB", default_value_t = 20.0)]
    cache_budget: f64,
    /// Keep all samples in memory, and use no prefix cache.
    #[arg(long)]
    no_cache: bool,
}

impl CacheOptions {
    /// Opens the cache; `None` if the user wants none. The default is the user's own cache.
    pub fn open(&self) -> Result<Option<DiskCache>> {
        self.open_or(default_folder)
    }

    /// As [`Self::open`], with another folder as the default.
    pub fn open_or(&self, default: impl FnOnce() -> Result<PathBuf>) -> Result<Option<DiskCache>> {
        if self.no_cache {
            return Ok(None);
        }
        if !(self.cache_budget >= 0.0 && self.cache_budget.is_finite()) {
            bail!(
                "--cache-budget is {}; it must be a number of gigabytes, 0 or more",
                self.cache_budget
            );
        }
        let folder = match &self.cache {
            Some(folder) => folder.clone(),
            None => default()?,
        };
        let cache = DiskCache::open(&folder, (self.cache_budget * 1e9) as u64);
        cache
            .context("the prefix cache cannot be opened; --cache DIR chooses another folder, and --no-cache uses none")
            .map(Some)
    }
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

/// Adds what the operator can do when the cache fails.
pub fn cache_failed(error: CacheError) -> anyhow::Error {
    match error {
        CacheError::Prepare(error) => error.into(),
        error => anyhow::Error::from(error)
            .context("the prefix cache failed; --no-cache keeps the samples in memory instead"),
    }
}
