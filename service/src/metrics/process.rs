//! What this process takes of its machine.

use std::fs;

/// Memory of this process in bytes; 0 if unknown.
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
