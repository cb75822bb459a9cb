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
