//! Key files: an ed25519 secret key as one line of hexadecimal digits, readable by its owner alone.

use anyhow::{bail, Context, Result};
use ed25519_dalek::SigningKey;
use std::io::{self, Write};
use std::path::Path;
use zk0_circuits::{Digest, NodeId};
use zk0_files::{atomic_file, bounded_file};

/// Largest key file that is read.
const MAX_KEY_BYTES: u64 = 200;

/// Makes a key, writes it to `path`, and returns its identity. An existing file is never overwritten.
pub fn generate(path: &Path) -> Result<NodeId> {
    let key = SigningKey::from_bytes(&random()?);
    write(path, &key).with_context(|| {
        format!(
            "creating the key file {} (an existing key is kept)",
            path.display()
        )
    })?;
    Ok(identity(&key))
}

/// Writes a key file whole or not at all.
fn write(path: &Path, key: &SigningKey) -> io::Result<()> {
    let folder = atomic_file::folder_of(path);
    // A temporary file can be read by its owner alone, and so can the key.
    let mut file = tempfile::NamedTempFile::new_in(folder)?;
    writeln!(file, "{}", Digest(key.to_bytes()))?;
    file.as_file().sync_all()?;
    file.persist_noclobber(path).map_err(|error| error.error)?;
    atomic_file::sync_folder(folder)
}

/// 32 bytes of the system's randomness.
pub fn random() -> Result<[u8; 32]> {
    let mut bytes = [0; 32];
    getrandom::fill(&mut bytes).context("the system gives no random bytes")?;
    Ok(bytes)
}

/// Reads the key in `path`.
pub fn read(path: &Path) -> Result<SigningKey> {
    let text = bounded_file::read(path, MAX_KEY_BYTES)
        .with_context(|| format!("reading the key file {}", path.display()))?;
    let secret: Option<Digest> = str::from_utf8(&text)
        .ok()
        .and_then(|text| text.trim().parse().ok());
    match secret {
        Some(secret) => Ok(SigningKey::from_bytes(&secret.0)),
        // The text may be most of a secret, so it is not repeated.
        None => bail!(
            "{} is not a key file; a key file is one line of 64 hexadecimal digits",
            path.display()
        ),
    }
}

/// The public identity of a key.
pub fn identity(key: &SigningKey) -> NodeId {
    NodeId(key.verifying_key().to_bytes())
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

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
    fn a_key_file_is_for_its_owner_alone() {
        use std::os::unix::fs::PermissionsExt;
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("node.key");
        generate(&path).unwrap();
        let mode = fs::metadata(&path).unwrap().permissions().mode();
        assert_eq!(mode & 0o777, 0o600);
        assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 1);
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
