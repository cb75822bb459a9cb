//! Shared memory that killed provers left.
//!
//! SP1's executor keeps a program's memory in `/dev/shm`. A killed process leaves gigabytes there, which the next prover may lack.

use std::fs::{self, DirEntry};
use std::io;
use std::os::unix::fs::MetadataExt;
use std::path::Path;
use std::time::{Duration, SystemTime};

/// Minimum age: between creating and mapping a file, a process seems not to use it.
const OLD: Duration = Duration::from_secs(60);

/// Removes this user's SP1 files in `folder` that no process has mapped and that are unchanged for a minute. The caller holds the lock of
/// provers. If the system hides the mappings, the files stay.
pub fn remove(folder: &Path) {
    let Ok(leftovers) = find(folder, SystemTime::now()) else {
        return;
    };
    let mut bytes = 0;
    let mut files = 0;
    for (name, size) in leftovers {
        match fs::remove_file(folder.join(&name)) {
            Ok(()) => {
                bytes += size;
                files += 1;
            }
            Err(error) => tracing::warn!("cannot remove {name} in {}: {error}", folder.display()),
        }
    }
    if files > 0 {
        let mib = bytes >> 20;
        tracing::info!(
            "removed {files} files of killed provers from {}, which held {mib} MiB of memory",
            folder.display()
        );
    }
}

/// The names of such files, and their bytes of memory.
fn find(folder: &Path, now: SystemTime) -> io::Result<Vec<(String, u64)>> {
    let mine = fs::metadata("/proc/self")?.uid();
    let mut found = old_files(fs::read_dir(folder)?, mine, now)?;
    if !found.is_empty() {
        let used = mapped(mine)?;
        found.retain(|(name, _)| {
            !used.contains(&format!("/{name}\n")) && !used.contains(&format!("/{name} "))
        });
    }
    Ok(found)
}

/// The same, mapped or not.
fn old_files(
    entries: impl Iterator<Item = io::Result<DirEntry>>,
    mine: u32,
    now: SystemTime,
) -> io::Result<Vec<(String, u64)>> {
    let mut found = vec![];
    for entry in entries {
        let entry = entry?;
        // Other processes may remove their files.
        let Ok(metadata) = entry.metadata() else {
            continue;
        };
        let name = entry.file_name();
        let Some(name) = name.to_str() else { continue };
        let old = now
            .duration_since(metadata.modified()?)
            .is_ok_and(|age| age > OLD);
        let of_sp1 = name
            .strip_prefix("sem.")
            .unwrap_or(name)
            .starts_with("sp1_");
        if of_sp1 && old && metadata.is_file() && metadata.uid() == mine {
            found.push((name.to_owned(), metadata.blocks() * 512));
        }
    }
    Ok(found)
}

/// The mappings of a user's processes, as the system prints them.
fn mapped(user: u32) -> io::Result<String> {
    let mut all = String::new();
    for entry in fs::read_dir("/proc")? {
        let entry = entry?;
        let process = entry.file_name();
        let is_process = process
            .to_str()
            .is_some_and(|name| name.parse::<u32>().is_ok());
        // A process may have ended.
        if !is_process
            || entry
                .metadata()
                .map_or(true, |metadata| metadata.uid() != user)
        {
            continue;
        }
        // Some system processes hide their mappings. Provers do not.
        if let Ok(maps) = fs::read_to_string(entry.path().join("maps")) {
            all.push_str(&maps);
        }
    }
    Ok(all)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_old_files_of_sp1_that_nobody_uses_are_left_over() {
        let folder = tempfile::tempdir().unwrap();
        for name in ["sp1_a_m", "sem.sp1_a_t_empty", "sp2_a", "other"] {
            fs::write(folder.path().join(name), [1; 5000]).unwrap();
        }
        assert_eq!(
            find(folder.path(), SystemTime::now()).unwrap(),
            [],
            "they are new"
        );
        let later = SystemTime::now() + 2 * OLD;
        let mut found = find(folder.path(), later).unwrap();
        found.sort();
        let names: Vec<&str> = found.iter().map(|(name, _)| &name[..]).collect();
        assert_eq!(names, ["sem.sp1_a_t_empty", "sp1_a_m"]);
        assert!(found[1].1 >= 5000, "{found:?}");
    }

    #[test]
    fn a_file_that_goes_meanwhile_does_not_keep_the_others() {
        let folder = tempfile::tempdir().unwrap();
        for name in ["sp1_a_m", "sp1_b_m"] {
            fs::write(folder.path().join(name), [1; 5000]).unwrap();
        }
        let entries: Vec<_> = fs::read_dir(folder.path()).unwrap().collect();
        fs::remove_file(folder.path().join("sp1_a_m")).unwrap();
        let mine = fs::metadata(folder.path()).unwrap().uid();
        let later = SystemTime::now() + 2 * OLD;
        let found = old_files(entries.into_iter(), mine, later).unwrap();
        let names: Vec<&str> = found.iter().map(|(name, _)| &name[..]).collect();
        assert_eq!(names, ["sp1_b_m"]);
    }

    /// A running program is a mapped file.
    #[test]
    fn a_file_that_is_mapped_stays() {
        let folder = tempfile::tempdir().unwrap();
        let sleep = folder.path().join("sp1_sleep");
        let own = ["/usr/bin/sleep", "/bin/sleep"]
            .into_iter()
            .find(|path| Path::new(path).exists());
        fs::copy(own.unwrap(), &sleep).unwrap();
        let mut running = std::process::Command::new(&sleep)
            .arg("60")
            .spawn()
            .unwrap();
        // The system maps the program a moment after it reports the process.
        let maps = format!("/proc/{}/maps", running.id());
        while !fs::read_to_string(&maps).unwrap().contains("/sp1_sleep") {
            std::thread::sleep(Duration::from_millis(1));
        }
        let later = SystemTime::now() + 2 * OLD;
        let found = find(folder.path(), later).unwrap();
        running.kill().unwrap();
        running.wait().unwrap();
        assert_eq!(found, []);
        assert_eq!(find(folder.path(), later).unwrap().len(), 1);
    }
}
