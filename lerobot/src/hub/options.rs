//! Where the Hub is, and who asks.

use std::path::PathBuf;

use hf_hub::Cache;

use crate::hub::error::HubError;

/// Where the Hub is, who asks, and where files go.
#[derive(Debug, Clone)]
pub struct HubOptions {
    /// Address of the Hub.
    pub endpoint: String,
    /// Access token, for private recordings.
    pub token: Option<String>,
    /// The cache's folder.
    pub cache: PathBuf,
}

impl HubOptions {
    /// Options from the environment: `HF_ENDPOINT`; `HF_TOKEN`, else the token of `hf auth login`; the cache `HF_HUB_CACHE`, else `hub` in
    /// `HF_HOME` (default `~/.cache/huggingface`).
    ///
    /// # Errors
    /// [`HubError::NoHome`].
    pub fn from_env() -> Result<Self, HubError> {
        let var = |name: &str| std::env::var(name).ok().filter(|v| !v.trim().is_empty());
        let cache = match var("HF_HOME") {
            Some(home) => Cache::new(PathBuf::from(home).join("hub")),
            // `hf_hub` would panic here.
            None if std::env::home_dir().is_none() => return Err(HubError::NoHome),
            None => Cache::default(),
        };
        Ok(Self {
            endpoint: var("HF_ENDPOINT").unwrap_or_else(|| "https://huggingface.co".into()),
            token: var("HF_TOKEN").or_else(|| cache.token()),
            cache: var("HF_HUB_CACHE").map_or_else(|| cache.path().clone(), PathBuf::from),
        })
    }
}
