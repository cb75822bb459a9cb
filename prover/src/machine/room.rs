//! Whether there is room for the argument of mode `succinct`, made before SP1 starts.

use super::options::Resources;
use std::io;
use std::path::{Path, PathBuf};
use zk0_argument::claim::Cost;

const GB: f64 = 1e9;

/// What is missing.
#[derive(Debug, thiserror::Error, PartialEq)]
pub enum NoRoom {
    /// Disk for the files of committed values.
    #[error(
        "the argument about the losses needs {:.1} GB of disk for the values of its samples, and {} has {:.1} GB free: free some, take a \
         folder on another disk, or have fewer samples evaluated",
        *needed as f64 / GB, folder.display(), *free as f64 / GB
    )]
    Disk {
        /// The files' folder.
        folder: PathBuf,
        /// Bytes needed.
        needed: u64,
        /// Bytes free.
        free: u64,
    },
    /// Memory for the prover.
    #[error(
        "the argument about the losses needs {:.1} GB of memory, and {:.1} GB are free: close other programs, or take another machine",
        *needed as f64 / GB, *free as f64 / GB
    )]
    Memory {
        /// Bytes needed.
        needed: u64,
        /// Bytes free.
        free: u64,
    },
}

/// Checks for enough bytes of disk.
pub fn check_disk(cost: &Cost, folder: &Path, free: u64) -> Result<(), NoRoom> {
    if cost.files <= free {
        Ok(())
    } else {
        Err(NoRoom::Disk {
            folder: folder.into(),
            needed: cost.files,
            free,
        })
    }
}

/// Checks for enough free memory.
pub fn check_memory(cost: &Cost, free: Resources) -> Result<(), NoRoom> {
    if cost.memory <= free.memory {
        Ok(())
    } else {
        Err(NoRoom::Memory {
            needed: cost.memory,
            free: free.memory,
        })
    }
}

/// Bytes of a folder's disk that this user can write.
pub fn free_disk(folder: &Path) -> io::Result<u64> {
    let disk = rustix::fs::statvfs(folder)?;
    Ok(disk.f_bavail.saturating_mul(disk.f_frsize))
}

#[cfg(test)]
mod tests {
    use super::*;

    const COST: Cost = Cost {
        seconds: 1.0,
        memory: 9_000_000_000,
        files: 4_000_000_000,
    };

    #[test]
    fn too_little_disk_says_how_much_is_needed_and_where() {
        let folder = Path::new("state");
        assert_eq!(check_disk(&COST, folder, COST.files), Ok(()));
        let error = check_disk(&COST, folder, COST.files - 1).unwrap_err();
        let text = error.to_string();
        assert!(
            text.contains("needs 4.0 GB of disk") && text.contains("state has 4.0 GB free"),
            "{text}"
        );
    }

    #[test]
    fn too_little_memory_says_how_much_is_needed() {
        let with = |memory| check_memory(&COST, Resources { memory, cores: 2 });
        assert_eq!(with(COST.memory), Ok(()));
        let text = with(2_000_000_000).unwrap_err().to_string();
        assert!(
            text.contains("needs 9.0 GB of memory, and 2.0 GB are free"),
            "{text}"
        );
    }

    #[test]
    fn a_disk_says_what_is_free() {
        let folder = tempfile::tempdir().unwrap();
        assert!(free_disk(folder.path()).unwrap() > 0);
        assert!(free_disk(&folder.path().join("missing")).is_err());
    }
}
