//! Memory left by control groups: `MemoryMax=` of systemd, or a container's limit.

use std::fs;
use std::path::Path;

/// Bytes left under the limits of this process's version 2 groups; `None` without a limit.
pub fn room() -> Option<u64> {
    let groups = fs::read_to_string("/proc/self/cgroup").ok()?;
    room_below(Path::new("/sys/fs/cgroup"), own(&groups)?)
}

/// The process's version 2 group in `/proc/self/cgroup`, usually `/` in a container.
fn own(groups: &str) -> Option<&str> {
    groups.lines().find_map(|line| line.strip_prefix("0::/"))
}

/// The least left in the group `own` and its parents.
fn room_below(root: &Path, own: &str) -> Option<u64> {
    let own = root.join(own);
    let groups = own.ancestors().take_while(|group| group.starts_with(root));
    groups.filter_map(left_in).min()
}

/// `None` without a limit. The group counts the page cache as used; the kernel can drop it, so it counts as free here.
fn left_in(group: &Path) -> Option<u64> {
    let number = |file: &str| -> Option<u64> {
        fs::read_to_string(group.join(file))
            .ok()?
            .trim()
            .parse()
            .ok()
    };
    let limit = number("memory.max")?; // "max" without a limit
    let used = number("memory.current")?;
    let cache: u64 = fs::read_to_string(group.join("memory.stat"))
        .ok()?
        .lines()
        .find_map(|line| line.strip_prefix("inactive_file "))?
        .trim()
        .parse()
        .ok()?;
    Some(limit.saturating_sub(used.saturating_sub(cache)))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn write(group: &Path, limit: &str) {
        fs::create_dir_all(group).unwrap();
        fs::write(group.join("memory.max"), limit).unwrap();
        fs::write(group.join("memory.current"), "700\n").unwrap();
        fs::write(group.join("memory.stat"), "anon 300\ninactive_file 300\n").unwrap();
    }

    #[test]
    fn a_control_group_limits_what_is_free() {
        let root = tempfile::tempdir().unwrap();
        assert_eq!(room_below(root.path(), ""), None);
        write(root.path(), "1000\n");
        assert_eq!(room_below(root.path(), ""), Some(600));
        write(root.path(), "max\n");
        assert_eq!(room_below(root.path(), ""), None);
    }

    /// systemd limits each service's group by `MemoryMax=`. The groups above may have limits, too.
    #[test]
    fn the_least_of_the_limits_of_a_service_and_of_the_groups_above_it_counts() {
        let root = tempfile::tempdir().unwrap();
        let own = "system.slice/zk0-prover.service";
        write(&root.path().join(own), "1000\n");
        assert_eq!(room_below(root.path(), own), Some(600));
        write(&root.path().join("system.slice"), "900\n");
        assert_eq!(room_below(root.path(), own), Some(500));
        write(&root.path().join("system.slice"), "max\n");
        assert_eq!(room_below(root.path(), own), Some(600));
        assert_eq!(room_below(root.path(), "elsewhere"), None);
    }

    #[test]
    fn the_groups_of_version_1_are_not_meant() {
        let groups = "4:memory:/other\n0::/system.slice/zk0-prover.service\n";
        assert_eq!(own(groups), Some("system.slice/zk0-prover.service"));
        assert_eq!(own("0::/\n"), Some(""));
        assert_eq!(own("4:memory:/other\n"), None);
    }
}
