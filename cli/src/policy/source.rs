//! The policy that a command uses.

use anyhow::{bail, Context, Result};
use std::fs;
use std::path::{Path, PathBuf};
use zk0_lerobot::hub::HubOptions;
use zk0_lerobot::policy_folder::{Inference, LeRobotConfig, PolicyFolder};
use zk0_lerobot::tokenizer::TrainedTokenizer;
use zk0_smolvla::policy::init::init_policy;
use zk0_smolvla::policy::policy_file::{self, PolicyFile};
use zk0_smolvla::policy::tokenizer::PolicyTokenizer;
use zk0_smolvla::{Policy, PolicyConfig, Profile};

/// Where a policy comes from.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum PolicySource {
    /// A policy file, or a LeRobot policy folder.
    Path(PathBuf),
    /// Random weights of a profile's dimensions.
    Random(Profile, u64),
}

impl PolicySource {
    /// Reads or makes the policy, with its tokenizer.
    pub fn load(&self) -> Result<PolicyFile> {
        match self {
            Self::Path(path) => read(path),
            Self::Random(..) => Ok(PolicyFile::hashing_words(self.policy()?)),
        }
    }

    /// Reads or makes the weights alone.
    pub fn policy(&self) -> Result<Policy> {
        match self {
            Self::Path(path) if path.is_dir() => read_folder(path),
            Self::Path(path) => Ok(read(path)?.policy),
            Self::Random(profile, seed) => Ok(init_policy(&profile.config(), *seed)?),
        }
    }

    /// How the policy is used, with any statistics of its training. Reads no weights.
    ///
    /// # Errors
    /// The policy cannot be read, or zk0 does not implement its normalisation.
    pub fn inference(&self) -> Result<Inference> {
        match self {
            Self::Path(path) if path.is_dir() => folder_inference(path),
            Self::Path(path) => Ok(policy_file::inference(path)?),
            Self::Random(..) => Ok(Inference::default()),
        }
    }

    /// The LeRobot policy folder, if there is one.
    pub fn lerobot(&self) -> Result<Option<PolicyFolder>> {
        match self {
            Self::Path(path) if path.is_dir() && !is_reference(path) => {
                Ok(Some(PolicyFolder::open(path)?))
            }
            _ => Ok(None),
        }
    }

    /// The policy's name, for people.
    pub fn name(&self) -> String {
        match self {
            Self::Path(path) => path.display().to_string(),
            Self::Random(profile, seed) => {
                format!("{} at random from seed {seed}", profile.name())
            }
        }
    }
}

/// Reads a policy file, a folder of LeRobot's `save_pretrained`, or a reference with policy_config.json, vlm_config.json and
/// weights.safetensors. The tokenizer is the file's, the folder's tokenizer.json, or that of the repository which the folder names, from
/// the Hub's cache. Without one, words are hashed, which suits policies that start at random.
pub fn read(path: &Path) -> Result<PolicyFile> {
    if !path.is_dir() {
        return policy_file::load(path)
            .with_context(|| format!("reading the policy {}", path.display()));
    }
    let policy = read_folder(path)?;
    let tokenizer = folder_tokenizer(path, &policy.config)?;
    Ok(PolicyFile { policy, tokenizer })
}

fn is_reference(folder: &Path) -> bool {
    folder.join("policy_config.json").exists()
}

fn read_folder(path: &Path) -> Result<Policy> {
    if !is_reference(path) {
        return Ok(Policy::from_folder(&PolicyFolder::open(path)?)?);
    }
    let mut config = reference_config(path)?.dims;
    // A reference does not rename cameras: the recording's names count.
    config.camera_names.clear();
    Policy::from_safetensors(&config, &file(path, "weights.safetensors")?)
        .with_context(|| format!("reading the policy {}", path.display()))
}

/// A reference has no statistics.
fn folder_inference(path: &Path) -> Result<Inference> {
    if !is_reference(path) {
        return Ok(PolicyFolder::open(path)?.inference()?);
    }
    let config = reference_config(path)?;
    let (state, action) = config
        .modes()
        .with_context(|| format!("reading the policy {}", path.display()))?;
    Ok(Inference {
        num_steps: config.num_steps,
        state,
        action,
        stats: None,
    })
}

fn reference_config(folder: &Path) -> Result<LeRobotConfig> {
    let json = |name: &str| {
        String::from_utf8(file(folder, name)?).with_context(|| format!("{name} is not text"))
    };
    let (policy, vlm) = (json("policy_config.json")?, json("vlm_config.json")?);
    Ok(LeRobotConfig::parse(&policy, Some(&vlm))?)
}

fn file(folder: &Path, name: &str) -> Result<Vec<u8>> {
    let path = folder.join(name);
    fs::read(&path).with_context(|| format!("reading {}", path.display()))
}

fn folder_tokenizer(folder: &Path, config: &PolicyConfig) -> Result<PolicyTokenizer> {
    let own = folder.join("tokenizer.json");
    let file = if is_reference(folder) {
        own.exists().then_some(own)
    } else {
        // Without a home directory there is no cache.
        let cache = HubOptions::from_env().ok().map(|options| options.cache);
        let file = PolicyFolder::open(folder)?.tokenizer_file(cache.as_deref())?;
        if file.is_none() {
            tracing::warn!(
                    "{} does not exist, so instructions are read as hashed words; a pretrained policy does not understand these",
                    own.display()
                );
        }
        file
    };
    match file {
        Some(file) => Ok(TrainedTokenizer::read(file, config)?.into()),
        None => Ok(PolicyTokenizer::word_hash(config)),
    }
}

/// The policy that one of two options names.
pub fn one(path: Option<&PathBuf>, profile: Option<Profile>, seed: u64) -> Result<PolicySource> {
    match (path, profile) {
        (Some(path), None) => Ok(PolicySource::Path(path.clone())),
        (None, Some(profile)) => Ok(PolicySource::Random(profile, seed)),
        _ => bail!("this command needs a policy: add --policy PATH or --profile NAME"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;
    use zk0_lerobot::tokenizer::Tokenizer;

    /// A byte-level BPE of three letters, `Ċ` being the line break.
    fn definition() -> Vec<u8> {
        let definition = json!({
            "version": "1.0", "truncation": null, "padding": null, "added_tokens": [],
            "normalizer": null, "post_processor": null, "decoder": null,
            "pre_tokenizer": {"type": "ByteLevel", "add_prefix_space": false, "trim_offsets": true, "use_regex": true},
            "model": {
                "type": "BPE", "dropout": null, "unk_token": null, "continuing_subword_prefix": null,
                "end_of_word_suffix": null, "fuse_unk": false, "byte_fallback": false,
                "vocab": {"g": 0, "o": 1, "go": 2, "Ċ": 3}, "merges": ["g o"]
            }
        });
        serde_json::to_vec(&definition).unwrap()
    }

    fn folder() -> (tempfile::TempDir, PolicySource) {
        let fixture = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/fixtures/smolvla_tiny");
        let dir = tempfile::tempdir().unwrap();
        for name in [
            "policy_config.json",
            "vlm_config.json",
            "weights.safetensors",
        ] {
            fs::copy(fixture.join(name), dir.path().join(name)).unwrap();
        }
        let source = PolicySource::Path(dir.path().to_owned());
        (dir, source)
    }

    fn tokens(source: &PolicySource) -> Vec<u32> {
        source.load().unwrap().tokenizer.tokens("go").unwrap()
    }

    #[test]
    fn a_folder_s_own_tokenizer_is_the_one_that_is_used() {
        let (dir, source) = folder();
        let hashed = PolicyTokenizer::word_hash(&source.policy().unwrap().config);
        assert_eq!(tokens(&source), hashed.tokens("go").unwrap());
        let file = dir.path().join("tokenizer.json");
        fs::write(&file, definition()).unwrap();
        assert_eq!(tokens(&source), [2, 3]);
        // An unusable file is an error.
        fs::write(&file, "{}").unwrap();
        assert!(source.load().is_err());
    }

    #[test]
    fn a_tokenizer_goes_along_into_the_policy_file() {
        let (dir, source) = folder();
        fs::write(dir.path().join("tokenizer.json"), definition()).unwrap();
        let loaded = source.load().unwrap();
        let path = dir.path().join("policy.safetensors");
        policy_file::save(&loaded.policy, &loaded.tokenizer, None, &path).unwrap();
        let file = PolicySource::Path(path);
        assert_eq!(tokens(&file), [2, 3]);
        assert_eq!(file.policy().unwrap(), loaded.policy);
    }
}
