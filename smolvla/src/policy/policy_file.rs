//! A whole policy as one safetensors file with LeRobot's names.
//!
//! Its metadata hold the policy's dimensions as JSON and the text of its `tokenizer.json`, if any. A network's genesis names this file by
//! its digest, so all nodes read instructions alike.
//!
//! A file from `zk0 train` also holds the policy's use ([`Inference`]) with its training's statistics. In a network, each node normalises
//! with its own.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, Write};
use std::path::Path;

use memmap2::Mmap;
use zk0_files::atomic_file::{self, Durability};
use zk0_lerobot::config::PolicyConfig;
use zk0_lerobot::policy_folder::Inference;
use zk0_lerobot::tokenizer::TrainedTokenizer;
use zk0_lerobot::{StoredPolicyError, StoredTensors};
use zk0_tensors::{write_to, TensorEntry, TensorFile, HEADER_LIMIT};

use crate::error::Result;
use crate::policy::tokenizer::PolicyTokenizer;
use crate::policy::weights::Policy;

pub use zk0_tensors::WrittenTensors;

/// Metadata key of the dimensions.
pub const CONFIG_KEY: &str = "zk0.config";
/// Metadata key of the tokenizer. Without it, words are hashed.
pub const TOKENIZER_KEY: &str = "zk0.tokenizer";
/// Metadata key of the use and its statistics.
pub const INFERENCE_KEY: &str = "zk0.inference";

/// The content of a policy file.
pub struct PolicyFile {
    /// The policy.
    pub policy: Policy,
    /// The tokenizer of its instructions.
    pub tokenizer: PolicyTokenizer,
}

impl PolicyFile {
    /// Words are hashed.
    pub fn hashing_words(policy: Policy) -> Self {
        Self {
            tokenizer: PolicyTokenizer::word_hash(&policy.config),
            policy,
        }
    }

    /// Writes the file for [`read`] piece by piece (1.8 GB at the published size). Equal policies give equal bytes.
    ///
    /// # Errors
    /// Those of `out`, or the tokenizer is too long for the metadata.
    pub fn write(&self, out: impl Write) -> io::Result<WrittenTensors> {
        write_used(&self.policy, &self.tokenizer, None, out)
    }
}

fn write_used(
    policy: &Policy,
    tokenizer: &PolicyTokenizer,
    inference: Option<&Inference>,
    out: impl Write,
) -> io::Result<WrittenTensors> {
    let config = serde_json::to_string(&policy.config)?;
    let inference = inference.map(serde_json::to_string).transpose()?;
    let mut notes = BTreeMap::from([(CONFIG_KEY, &config[..])]);
    notes.extend(tokenizer.definition().map(|text| (TOKENIZER_KEY, text)));
    notes.extend(inference.as_deref().map(|text| (INFERENCE_KEY, text)));
    write_to(out, policy.tensors().map(TensorEntry::of).collect(), notes)
}

/// Reads what [`PolicyFile::write`] wrote.
///
/// # Errors
/// Those of [`Policy::from_safetensors`], or dimensions or tokenizer are not usable.
pub fn read(bytes: &[u8]) -> Result<PolicyFile> {
    let file = TensorFile::open(bytes, HEADER_LIMIT)?;
    let note = |key| file.metadata().as_ref().and_then(|notes| notes.get(key));
    let config = note(CONFIG_KEY).ok_or_else(|| {
        StoredPolicyError::Config(format!("the file's metadata has no `{CONFIG_KEY}`"))
    })?;
    let config: PolicyConfig =
        serde_json::from_str(config).map_err(|e| StoredPolicyError::Config(e.to_string()))?;
    // The tokenizer needs checked dimensions.
    let policy = Policy::from_safetensors(&config, bytes)?;
    let tokenizer = match note(TOKENIZER_KEY) {
        Some(text) => TrainedTokenizer::parse(text, &config)?.into(),
        None => PolicyTokenizer::word_hash(&config),
    };
    Ok(PolicyFile { policy, tokenizer })
}

/// Reads the file `path` through a memory map, without a copy.
///
/// # Errors
/// Those of [`read`], and [`StoredPolicyError::AtPath`].
pub fn load(path: &Path) -> Result<PolicyFile> {
    let failed = |cause: io::Error| StoredPolicyError::file(path, cause);
    let file = File::open(path).map_err(failed)?;
    // SAFETY: the bytes are checked, and only used as names and numbers. A process that shortens the file meanwhile can end this one, but
    // do no other harm.
    let map = unsafe { Mmap::map(&file) }.map_err(failed)?;
    read(&map)
}

/// The use of the policy in the file `path`; by default LeRobot's. Reads no weight.
///
/// # Errors
/// [`StoredPolicyError::AtPath`].
pub fn inference(path: &Path) -> Result<Inference> {
    let file = StoredTensors::open(path)?;
    let note = |key| file.metadata().as_ref().and_then(|all| all.get(key));
    let Some(text) = note(INFERENCE_KEY) else {
        return Ok(Inference::default());
    };
    let broken = |key: &str, cause: &dyn std::fmt::Display| {
        StoredPolicyError::file(path, format!("`{key}` in the file's metadata: {cause}"))
    };
    let config = note(CONFIG_KEY).ok_or_else(|| broken(CONFIG_KEY, &"is missing"))?;
    let config: PolicyConfig = serde_json::from_str(config).map_err(|e| broken(CONFIG_KEY, &e))?;
    let inference: Inference = serde_json::from_str(text).map_err(|e| broken(INFERENCE_KEY, &e))?;
    let checked = inference.check(&config);
    checked.map_err(|e| broken(INFERENCE_KEY, &e))?;
    Ok(inference)
}

/// Writes the file for [`load`], whole or not at all, with a trained policy's `inference`. Returns its SHA-256.
///
/// # Errors
/// [`StoredPolicyError::AtPath`].
pub fn save(
    policy: &Policy,
    tokenizer: &PolicyTokenizer,
    inference: Option<&Inference>,
    path: &Path,
) -> Result<[u8; 32]> {
    let written = atomic_file::write(path, Durability::OnDisk, |out| {
        write_used(policy, tokenizer, inference, out)
    });
    match written {
        Ok(written) => Ok(written.digest),
        Err(cause) => Err(StoredPolicyError::file(path, cause).into()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::error::PolicyError;
    use crate::policy::init::init_policy;
    use crate::policy::profile::Profile;
    use serde_json::json;
    use zk0_lerobot::dataset::{Normalizer, Stats};
    use zk0_lerobot::tokenizer::Tokenizer;

    fn micro() -> PolicyFile {
        PolicyFile::hashing_words(init_policy(&Profile::Micro.config(), 3).unwrap())
    }

    fn bytes(file: &PolicyFile) -> Vec<u8> {
        let mut bytes = Vec::new();
        file.write(&mut bytes).unwrap();
        bytes
    }

    fn words(words: &[&str]) -> String {
        let ids = words.iter().enumerate();
        let vocabulary: serde_json::Map<_, _> =
            ids.map(|(i, w)| (w.to_string(), i.into())).collect();
        let definition = json!({
            "version": "1.0", "truncation": null, "padding": null, "added_tokens": [],
            "normalizer": null, "pre_tokenizer": {"type": "Whitespace"}, "post_processor": null, "decoder": null,
            "model": {"type": "WordLevel", "vocab": vocabulary, "unk_token": "?"}
        });
        definition.to_string()
    }

    fn with_tokenizer(text: &str) -> PolicyFile {
        let PolicyFile { policy, .. } = micro();
        let trained = TrainedTokenizer::parse(text, &policy.config).unwrap();
        PolicyFile {
            policy,
            tokenizer: trained.into(),
        }
    }

    #[test]
    fn a_policy_comes_back_with_its_dimensions() {
        let file = micro();
        let written = bytes(&file);
        assert_eq!(written, bytes(&file));
        let back = read(&written).unwrap();
        assert_eq!(back.policy, file.policy);
        assert_eq!(back.tokenizer.definition(), None);
    }

    #[test]
    fn a_policy_s_tokenizer_comes_back_and_is_the_one_that_is_used() {
        let text = words(&["?", "stack", "the", "cube"]);
        let file = with_tokenizer(&text);
        let written = bytes(&file);
        assert_eq!(written, bytes(&file));
        let back = read(&written).unwrap();
        assert_eq!(back.policy, file.policy);
        assert_eq!(back.tokenizer.definition(), Some(&text[..]));
        assert_eq!(
            back.tokenizer.tokens("stack the red cube").unwrap(),
            [1, 2, 0, 3]
        );
        let hashed = micro().tokenizer.tokens("stack the red cube").unwrap();
        assert_ne!(hashed, [1, 2, 0, 3]);
        let other = with_tokenizer(&words(&["?", "cube", "the", "stack"]));
        assert_ne!(
            bytes(&other),
            written,
            "the file's digest binds the tokenizer"
        );
    }

    #[test]
    fn a_broken_tokenizer_is_an_error_and_not_passed_over() {
        let policy = micro().policy;
        let config = serde_json::to_string(&policy.config).unwrap();
        for text in ["", "{}", "no JSON"] {
            let mut bytes = Vec::new();
            let notes = BTreeMap::from([(CONFIG_KEY, &config[..]), (TOKENIZER_KEY, text)]);
            let tensors = policy.tensors().map(TensorEntry::of).collect();
            write_to(&mut bytes, tensors, notes).unwrap();
            match read(&bytes) {
                Err(PolicyError::Stored(StoredPolicyError::Tokenizer(_))) => {}
                Err(other) => panic!("{other}"),
                Ok(_) => panic!("{text:?} was passed over"),
            }
        }
    }

    #[test]
    fn a_file_that_was_saved_is_one_that_was_written() {
        for file in [micro(), with_tokenizer(&words(&["?", "cube"]))] {
            let dir = tempfile::tempdir().unwrap();
            let path = dir.path().join("policy.safetensors");
            let digest = save(&file.policy, &file.tokenizer, None, &path).unwrap();
            assert_eq!(load(&path).unwrap().policy, file.policy);
            let saved = std::fs::read(&path).unwrap();
            assert_eq!(saved, bytes(&file));
            assert_eq!(
                digest[..],
                <sha2::Sha256 as sha2::Digest>::digest(&saved)[..]
            );
            let error = load(&dir.path().join("none")).err().unwrap().to_string();
            assert!(error.contains("none"), "{error}");
        }
    }

    #[test]
    fn how_a_policy_is_used_comes_back_and_changes_nothing_else() {
        let (dir, file) = (tempfile::tempdir().unwrap(), micro());
        let path = dir.path().join("policy.safetensors");
        save(&file.policy, &file.tokenizer, None, &path).unwrap();
        assert_eq!(inference(&path).unwrap(), Inference::default());
        let with = |dim: usize| Inference {
            num_steps: 3,
            stats: Some(Stats {
                state: Normalizer::new(vec![0.3; dim], vec![0.7; dim]).unwrap(),
                action: Normalizer::identity(dim).unwrap(),
            }),
            ..Inference::default()
        };
        save(&file.policy, &file.tokenizer, Some(&with(6)), &path).unwrap();
        assert_eq!(inference(&path).unwrap(), with(6));
        let back = load(&path).unwrap();
        assert_eq!(back.policy, file.policy);
        assert_eq!(bytes(&back), bytes(&file));

        save(&file.policy, &file.tokenizer, Some(&with(5)), &path).unwrap();
        let reported = inference(&path).unwrap_err().to_string();
        assert!(
            reported.contains("zk0.inference") && reported.contains("5 state"),
            "{reported}"
        );
        let config = serde_json::to_string(&file.policy.config).unwrap();
        let notes = BTreeMap::from([(CONFIG_KEY, &config[..]), (INFERENCE_KEY, "{}")]);
        let tensors = file.policy.tensors().map(TensorEntry::of).collect();
        write_to(File::create(&path).unwrap(), tensors, notes).unwrap();
        let reported = inference(&path).unwrap_err().to_string();
        assert!(
            reported.contains("policy.safetensors") && reported.contains("num_steps"),
            "{reported}"
        );
    }

    #[test]
    fn a_file_without_dimensions_or_with_absurd_ones_is_refused() {
        let mut file = micro();
        assert!(matches!(
            read(&file.policy.to_safetensors().unwrap()),
            Err(PolicyError::Stored(StoredPolicyError::Config(_)))
        ));
        file.policy.config.text.layers = usize::MAX;
        assert!(matches!(
            read(&bytes(&file)),
            Err(PolicyError::Stored(StoredPolicyError::Config(_)))
        ));
    }
}
