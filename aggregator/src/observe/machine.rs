//! What the process uses of its machine.

use std::fs;
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

/// Memory of this process, in bytes; 0 if unknown.
pub fn memory() -> u64 {
    let status = fs::read_to_string("/proc/self/status").unwrap_or_default();
    let resident = status.lines().find_map(|line| line.strip_prefix("VmRSS:"));
    let kilobytes = resident.and_then(|size| size.trim().strip_suffix(" kB"));
    let kilobytes = kilobytes.and_then(|size| size.parse::<u64>().ok());
    kilobytes.unwrap_or(0) << 10
}

/// Open files of this process; 0 if unknown.
pub fn open_files() -> u64 {
    fs::read_dir("/proc/self/fd").map_or(0, |files| files.count() as u64)
}
