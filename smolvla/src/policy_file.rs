//! A whole policy as one file: safetensors with LeRobot's names, the dimensions as JSON in the file's metadata. What a
//! network's genesis names by its digest.

use std::collections::HashMap;

use safetensors::SafeTensors;

use crate::config::PolicyConfig;
use crate::error::{PolicyError, Result};
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
