//! The policy that a command is told to use.

use anyhow::{bail, Context, Result};
use std::{
    fs,
    path::{Path, PathBuf},
};
use zk0_smolvla::{
    init::init_policy,
    policy_file,
    tokenizer::{Tokenizer, WordHash},
    trained_tokenizer::TrainedTokenizer,
    Checkpoint, Policy, PolicyConfig, Profile,
};

/// Where a policy comes from.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum PolicySource {
    /// A policy file, or a folder of LeRobot's.
    Path(PathBuf),
    /// Random weights of a profile's dimensions.
    Random(Profile, u64),
}

impl PolicySource {
    /// Reads or makes it.
    pub fn load(&self) -> Result<Policy> {
        match self {
            Self::Path(path) => read(path),
            Self::Random(profile, seed) => Ok(init_policy(&profile.config(), *seed)?),
        }
    }

    /// For people.
    pub fn name(&self) -> String {
        match self {
            Self::Path(path) => path.display().to_string(),
            Self::Random(profile, seed) => {
                format!("{} at random from seed {seed}", profile.name())
            }
        }
    }
}

/// Reads a policy file, or a folder: a checkpoint as LeRobot's `save_pretrained` writes it, or a reference with
/// policy_config.json, vlm_config.json and weights.safetensors.
pub fn read(path: &Path) -> Result<Policy> {
    if !path.is_dir() {
        return policy_file::load(path)
            .with_context(|| format!("reading the policy {}", path.display()));
    }
    if !path.join("policy_config.json").exists() {
        return Ok(Checkpoint::open(path)?.policy()?);
    }
    let file = |name: &str| {
        let path = path.join(name);
        fs::read(&path).with_context(|| format!("reading {}", path.display()))
    };
    let json =
        |name: &str| String::from_utf8(file(name)?).with_context(|| format!("{name} is not text"));
    let config =
        PolicyConfig::from_lerobot(&json("policy_config.json")?, &json("vlm_config.json")?)?;
    Policy::from_safetensors(&config, &file("weights.safetensors")?)
        .with_context(|| format!("reading the policy {}", path.display()))
}

/// What turns instructions into a policy's tokens: `tokenizer.json` in the policy's folder, else a hash of each word, which
/// suits policies that start at random.
pub fn tokenizer(source: &PolicySource, config: &PolicyConfig) -> Result<Box<dyn Tokenizer>> {
    if let PolicySource::Path(path) = source {
        let file = path.join("tokenizer.json");
        if file.exists() {
            return Ok(Box::new(TrainedTokenizer::read(file, config)?));
        }
        if path.join("config.json").exists() {
            tracing::warn!(
                "{} is not there: instructions become hashed words, which a pretrained policy does not understand",
                file.display()
            );
        }
    }
    Ok(Box::new(WordHash::new(config)))
}

/// One of the two ways of naming a policy.
pub fn one(path: Option<&PathBuf>, profile: Option<Profile>, seed: u64) -> Result<PolicySource> {
    match (path, profile) {
        (Some(path), None) => Ok(PolicySource::Path(path.clone())),
        (None, Some(profile)) => Ok(PolicySource::Random(profile, seed)),
        _ => bail!("which policy? Give --policy PATH or --profile NAME"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    /// A policy's folder with a tokenizer, or without.
    fn folder(tokenizer: bool) -> (tempfile::TempDir, PolicySource) {
        let dir = tempfile::tempdir().unwrap();
        if tokenizer {
            // A byte-level BPE of three letters, `Ċ` being the line break.
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
            let text = serde_json::to_vec(&definition).unwrap();
            fs::write(dir.path().join("tokenizer.json"), text).unwrap();
        }
        let source = PolicySource::Path(dir.path().to_owned());
        (dir, source)
    }

    #[test]
    fn a_folder_s_own_tokenizer_is_the_one_that_is_used() {
        let config = Profile::Micro.config();
        let tokens = |source: &PolicySource| tokenizer(source, &config).unwrap().tokens("go");
        let (_with, own) = folder(true);
        assert_eq!(tokens(&own).unwrap(), [2, 3]);
        let (without, hashed) = folder(false);
        let expected = WordHash::new(&config).tokens("go").unwrap();
        assert_eq!(tokens(&hashed).unwrap(), expected);
        // One that cannot be used is an error, never passed over.
        fs::write(without.path().join("tokenizer.json"), "{}").unwrap();
        assert!(tokenizer(&hashed, &config).is_err());
    }
}
