//! Where the Hub is, and who asks.

use std::path::PathBuf;

use hf_hub::Cache;

use crate::hub::error::HubError;

/// Where the Hub is, who asks, and where files are kept.
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
    /// What the environment says: `HF_ENDPOINT`; `HF_TOKEN`, else the token that `hf auth login` left; `HF_HUB_CACHE`, the cache, else
    /// `HF_HOME`, whose `hub` is the cache (`~/.cache/huggingface` without it).
    ///
    /// # Errors
    /// [`HubError::NoHome`].
    pub fn from_env() -> Result<Self, HubError> {
        let var = |name: &str| std::env::var(name).ok().filter(|v| !v.trim().is_empty());
        let cache = match var("HF_HOME") {
            Some(home) => Cache::new(PathBuf::from(home).join("hub")),
            // `hf_hub` would panic on such a name.
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
