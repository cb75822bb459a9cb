//! What is left of the machine.

use std::io;
use std::path::Path;

/// A disk.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Disk {
    /// Bytes that this process may write.
    pub free: u64,
    /// Bytes in all.
    pub size: u64,
}

impl Disk {
    /// The disk that holds this folder.
    pub fn of(folder: &Path) -> io::Result<Self> {
        let disk = rustix::fs::statvfs(folder)?;
        Ok(Self {
            free: disk.f_bavail.saturating_mul(disk.f_frsize),
            size: disk.f_blocks.saturating_mul(disk.f_frsize),
        })
    }

    /// Free, in whole per cent, rounded down.
    pub fn free_percent(self) -> u32 {
        let percent = u128::from(self.free) * 100 / u128::from(self.size.max(1));
        percent.min(100) as u32
    }
}
