//! Key files: an ed25519 secret key as a line of hexadecimal digits, readable by its owner alone.

use anyhow::{bail, Context, Result};
use ed25519_dalek::SigningKey;
use std::fs;
use std::io::{self, ErrorKind, Write};
use std::os::unix::fs::PermissionsExt;
use std::path::Path;
use zk0_circuits::{Digest, NodeId};
use zk0_files::{atomic_file, bounded_file};

const MAX_KEY_BYTES: u64 = 200;

/// Makes a key, writes it to `path`, and returns its identity. Never overwrites a file.
pub fn generate(path: &Path) -> Result<NodeId> {
    let folder = atomic_file::folder_of(path);
    if !folder.exists() {
        bail!(
            "the key file {} cannot be made, because the folder {} does not exist: make the folder first",
            path.display(),
            folder.display()
        );
    }
    let key = SigningKey::from_bytes(&random()?);
    let file = path.display();
    match write(path, &key) {
        Ok(()) => Ok(identity(&key)),
        Err(error) if error.kind() == ErrorKind::AlreadyExists => bail!(
            "{file} exists, and an existing key is kept. `zk0 node identity {file}` prints the identity of this key; `zk0 witness serve` \
             logs the verifier key of a witness"
        ),
        Err(error) => Err(error).with_context(|| format!("creating the key file {file}")),
    }
}

/// Whole or not at all.
fn write(path: &Path, key: &SigningKey) -> io::Result<()> {
    let folder = atomic_file::folder_of(path);
    // Temporary files are readable by their owner alone.
    let mut file = tempfile::NamedTempFile::new_in(folder)?;
    writeln!(file, "{}", Digest(key.to_bytes()))?;
    file.as_file().sync_all()?;
    file.persist_noclobber(path).map_err(|error| error.error)?;
    atomic_file::sync_folder(folder)
}

/// 32 random bytes from the system.
pub fn random() -> Result<[u8; 32]> {
    let mut bytes = [0; 32];
    getrandom::fill(&mut bytes).context("the system gives no random bytes")?;
    Ok(bytes)
}

/// Reads the key in `path`. Warns if others can read the file.
pub fn read(path: &Path) -> Result<SigningKey> {
    let text = bounded_file::read(path, MAX_KEY_BYTES)
        .with_context(|| format!("reading the key file {}", path.display()))?;
    // A key is used even if its readers are unknown.
    if let Ok(about) = fs::metadata(path) {
        if let Some(warning) = readable_by_others(path, about.permissions().mode()) {
            tracing::warn!("{warning}");
        }
    }
    let secret: Option<Digest> = str::from_utf8(&text)
        .ok()
        .and_then(|text| text.trim().parse().ok());
    match secret {
        Some(secret) => Ok(SigningKey::from_bytes(&secret.0)),
        // The text may be most of a secret: never repeat it.
        None => bail!(
            "{} is not a key file; a key file is one line of 64 hexadecimal digits",
            path.display()
        ),
    }
}

/// Advice if others can read the key file. A service may read its key by its group alone, as in Kubernetes.
fn readable_by_others(path: &Path, mode: u32) -> Option<String> {
    let (mode, path) = (mode & 0o777, path.display());
    match (mode & 0o004, mode & 0o040) {
        (0, 0) => None,
        (0, _) => Some(format!(
            "its group can read the key file {path} (mode {mode:o}): run `chmod 600 {path}`, unless the group is this service's alone"
        )),
        _ => Some(format!(
            "all users of this machine can read the key file {path} (mode {mode:o}): run `chmod 600 {path}`"
        )),
    }
}

/// [`read`], after making the key if there is no such file.
pub fn read_or_generate(path: &Path) -> Result<SigningKey> {
    if !path.exists() {
        generate(path)?;
    }
    read(path)
}

/// A key's public identity.
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
        let refused = generate(&path).unwrap_err().to_string();
        assert!(refused.contains("zk0 node identity"), "{refused}");
        assert_eq!(identity(&read(&path).unwrap()), node);
    }

    #[test]
    fn a_key_file_is_for_its_owner_alone() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("node.key");
        generate(&path).unwrap();
        let mode = fs::metadata(&path).unwrap().permissions().mode();
        assert_eq!(mode & 0o777, 0o600);
        assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 1);
    }

    #[test]
    fn a_key_file_that_others_can_read_is_warned_of() {
        let warning = |mode| readable_by_others(Path::new("log.key"), mode);
        for mode in [0o100600, 0o100400, 0o100700, 0o100611] {
            assert_eq!(warning(mode), None, "{mode:o}");
        }
        for (mode, reports) in [
            (0o100644, "all users of this machine"),
            (0o100604, "(mode 604)"),
            (0o100640, "its group"),
            (0o100440, "(mode 440)"),
        ] {
            let warning = warning(mode).unwrap();
            assert!(warning.contains(reports), "{warning}");
            assert!(warning.contains("`chmod 600 log.key`"), "{warning}");
        }
    }

    #[test]
    fn a_folder_that_is_missing_is_named() {
        let dir = tempfile::tempdir().unwrap();
        let message = generate(&dir.path().join("none/node.key")).unwrap_err();
        let message = format!("{message:#}");
        assert!(message.contains("none does not exist"), "{message}");
        assert!(!message.contains("existing key"), "{message}");
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
