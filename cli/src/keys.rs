//! Key files: an ed25519 secret key as one line of hexadecimal, readable by its owner alone.

use anyhow::{bail, Context, Result};
use ed25519_dalek::SigningKey;
use std::{fs, io::Write, os::unix::fs::OpenOptionsExt, path::Path};
use zk0_circuits::{Digest, NodeId};

/// Makes a key and writes it to `path`; an existing file is never overwritten.
pub fn generate(path: &Path) -> Result<NodeId> {
    let mut secret = [0; 32];
    getrandom::fill(&mut secret).context("the system gives no random bytes")?;
    let key = SigningKey::from_bytes(&secret);
    let mut file = fs::OpenOptions::new()
        .write(true)
        .create_new(true)
        .mode(0o600)
        .open(path)
        .with_context(|| {
            format!(
                "creating the key file {} (an existing key is kept)",
                path.display()
            )
        })?;
    writeln!(file, "{}", Digest(secret))?;
    file.sync_all()?;
    Ok(identity(&key))
}

/// 32 bytes of the system's randomness.
pub fn random() -> Result<[u8; 32]> {
    let mut bytes = [0; 32];
    getrandom::fill(&mut bytes).context("the system gives no random bytes")?;
    Ok(bytes)
}

/// Reads the key in `path`.
pub fn read(path: &Path) -> Result<SigningKey> {
    let size = fs::metadata(path)
        .with_context(|| format!("reading the key file {}", path.display()))?
        .len();
    if size > 200 {
        bail!(
            "{} has {size} bytes: a key file is one line of 64 hexadecimal digits",
            path.display()
        );
    }
    let text = fs::read_to_string(path)
        .with_context(|| format!("reading the key file {}", path.display()))?;
    let secret: Digest = match text.trim().parse() {
        Ok(secret) => secret,
        // The text may be most of a secret: it is not repeated.
        Err(_) => bail!(
            "{} is no key file: one line of 64 hexadecimal digits",
            path.display()
        ),
    };
    Ok(SigningKey::from_bytes(&secret.0))
}

/// The public identity of a key.
pub fn identity(key: &SigningKey) -> NodeId {
    NodeId(key.verifying_key().to_bytes())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_key_comes_back_and_is_never_overwritten() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("node.key");
        let node = generate(&path).unwrap();
        assert_eq!(identity(&read(&path).unwrap()), node);
        assert!(generate(&path).is_err());
        assert_eq!(identity(&read(&path).unwrap()), node);
    }

    #[test]
    fn a_broken_key_file_is_refused_without_repeating_it() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("node.key");
        fs::write(&path, "5ec2e7").unwrap();
        let message = format!("{:#}", read(&path).unwrap_err());
        assert!(
            message.contains("64 hexadecimal digits") && !message.contains("5ec2e7"),
            "{message}"
        );
    }
}
