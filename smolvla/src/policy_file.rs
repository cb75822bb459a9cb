//! A whole policy as one file: safetensors with LeRobot's names, the dimensions as JSON in the file's metadata. What a
//! network's genesis names by its digest.

use std::borrow::Cow;
use std::collections::HashMap;
use std::fs::File;
use std::path::Path;

use memmap2::Mmap;
use safetensors::SafeTensors;

use crate::config::PolicyConfig;
use crate::error::{PolicyError, Result};
use crate::safetensors_writer::{self, Entry};
use crate::weights::{write as write_tensors, Policy};

/// Key of the file's metadata under which the dimensions are.
pub const CONFIG_KEY: &str = "zk0.config";

/// The bytes of the file; equal policies give equal bytes.
pub fn write(policy: &Policy) -> Result<Vec<u8>> {
    let config =
        serde_json::to_string(&policy.config).map_err(|e| PolicyError::Config(e.to_string()))?;
    let mut all = policy.frozen.clone();
    all.extend(policy.expert.tensors().clone());
    write_tensors(&all, Some(HashMap::from([(CONFIG_KEY.into(), config)])))
}

/// Reads what [`write`] wrote.
///
/// # Errors
/// As [`Policy::from_safetensors`], and when the dimensions are missing or not usable.
pub fn read(bytes: &[u8]) -> Result<Policy> {
    let (_, header) =
        SafeTensors::read_metadata(bytes).map_err(|e| PolicyError::Safetensors(e.to_string()))?;
    let config = header
        .metadata()
        .as_ref()
        .and_then(|metadata| metadata.get(CONFIG_KEY))
        .ok_or_else(|| PolicyError::Config(format!("the file's metadata has no `{CONFIG_KEY}`")))?;
    let config: PolicyConfig =
        serde_json::from_str(config).map_err(|e| PolicyError::Config(e.to_string()))?;
    Policy::from_safetensors(&config, bytes)
}

/// Reads the file `path`, through a memory map: at the published size a copy of its bytes would be 1.8 GB.
///
/// # Errors
/// As [`read`], and [`PolicyError::AtPath`].
pub fn load(path: &Path) -> Result<Policy> {
    let failed = |cause: std::io::Error| PolicyError::file(path, cause);
    let file = File::open(path).map_err(failed)?;
    // SAFETY: the bytes are taken for names and numbers only and checked as such. Whoever cuts the file off while it is being
    // read ends this process, no more.
    let map = unsafe { Mmap::map(&file) }.map_err(failed)?;
    read(&map)
}

/// Writes what [`load`] reads, piece by piece and then renamed: whole or not at all. Returns the file's SHA-256.
///
/// # Errors
/// [`PolicyError::AtPath`].
pub fn save(policy: &Policy, path: &Path) -> Result<[u8; 32]> {
    let config =
        serde_json::to_string(&policy.config).map_err(|e| PolicyError::Config(e.to_string()))?;
    let tensors = policy.frozen.iter().chain(policy.expert.tensors());
    let entries = tensors.map(|(name, tensor)| Entry {
        name: name.clone(),
        shape: tensor.shape.clone(),
        values: Cow::Borrowed(&tensor.data[..]),
    });
    let unfinished = path.with_extension("unfinished");
    safetensors_writer::write(&unfinished, entries.collect(), Some((CONFIG_KEY, &config)))
        .and_then(|written| {
            std::fs::rename(&unfinished, path)?;
            Ok(written.digest)
        })
        .map_err(|cause: std::io::Error| PolicyError::file(path, cause))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{init::init_policy, Profile};

    #[test]
    fn a_policy_comes_back_with_its_dimensions() {
        let policy = init_policy(&Profile::Micro.config(), 3).unwrap();
        let bytes = write(&policy).unwrap();
        assert_eq!(bytes, write(&policy).unwrap());
        assert_eq!(read(&bytes).unwrap(), policy);
    }

    #[test]
    fn a_file_that_was_saved_is_one_that_was_written() {
        let policy = init_policy(&Profile::Micro.config(), 3).unwrap();
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("policy.safetensors");
        let digest = save(&policy, &path).unwrap();
        assert_eq!(load(&path).unwrap(), policy);
        let bytes = std::fs::read(&path).unwrap();
        assert_eq!(bytes, write(&policy).unwrap());
        assert_eq!(
            digest[..],
            <sha2::Sha256 as sha2::Digest>::digest(&bytes)[..]
        );
        let error = load(&dir.path().join("none")).unwrap_err().to_string();
        assert!(error.contains("none"), "{error}");
    }

    #[test]
    fn a_file_without_dimensions_or_with_absurd_ones_is_refused() {
        let policy = init_policy(&Profile::Micro.config(), 3).unwrap();
        assert!(matches!(
            read(&policy.to_safetensors().unwrap()),
            Err(PolicyError::Config(_))
        ));
        let mut absurd = policy;
        absurd.config.text.layers = usize::MAX;
        assert!(matches!(
            read(&write(&absurd).unwrap()),
            Err(PolicyError::Config(_))
        ));
    }
}
