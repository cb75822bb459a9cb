//! SP1's options for the CPU, by free memory and cores.
//!
//! SP1's defaults suit a server: four provers at a time over shards of 400 million trace elements. On a small machine, the kernel kills
//! them after minutes.

use super::control_group;
use sp1_core_executor::SP1CoreOpts;
use std::fs;

const GIB: u64 = 1 << 30;

/// What a proof can use.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Resources {
    /// Memory free without swapping, in bytes.
    pub memory: u64,
    /// Hardware threads.
    pub cores: usize,
}

/// Why there are no options.
#[derive(Debug, thiserror::Error, PartialEq, Eq)]
pub enum OptionsError {
    /// The proof would not fit.
    #[error(
        "a compressed proof needs {:.1} GiB of free memory and {:.1} GiB are free: close other programs, or prove on another \
         machine",
        gib(.needed), gib(.free)
    )]
    TooLittleMemory {
        /// Bytes needed.
        needed: u64,
        /// Bytes free.
        free: u64,
    },
    /// The system does not report its free memory.
    #[error("zk0 cannot tell how much memory is free: {0}")]
    Unknown(String),
}

fn gib(bytes: &u64) -> f64 {
    *bytes as f64 / GIB as f64
}

impl Resources {
    /// Reads `MemAvailable`, the limits of control groups, and the usable cores.
    pub fn of_this_machine() -> Result<Self, OptionsError> {
        let meminfo = fs::read_to_string("/proc/meminfo")
            .map_err(|error| OptionsError::Unknown(format!("/proc/meminfo: {error}")))?;
        let available = bytes_of("MemAvailable:", &meminfo)
            .ok_or_else(|| OptionsError::Unknown("no MemAvailable in /proc/meminfo".into()))?;
        let memory = match control_group::room() {
            Some(room) => available.min(room),
            None => available,
        };
        let cores = std::thread::available_parallelism().map_or(1, |cores| cores.get());
        Ok(Self { memory, cores })
    }
}

/// This process's peak memory so far, in bytes, if the system reports it.
pub fn peak_memory() -> Option<u64> {
    bytes_of("VmHWM:", &fs::read_to_string("/proc/self/status").ok()?)
}

/// A size in a /proc file, in bytes.
fn bytes_of(name: &str, text: &str) -> Option<u64> {
    let line = text.lines().find_map(|line| line.strip_prefix(name))?;
    let kibibytes: u64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    kibibytes.checked_mul(1024)
}

/// SP1's options on this machine's CPU.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ProverOptions {
    /// Most trace elements in a shard.
    pub element_threshold: u64,
    /// Most rows of one table in a shard.
    pub height_threshold: u64,
    /// Workers of each kind, and buffer slots between them: the shards in memory at the same time.
    pub workers: usize,
}

/// Free memory for shards of twice the smallest size: a claim of 7.4 M cycles, several full shards of 192 Mi elements, peaked at 22.6 GiB.
const MIDDLE: u64 = 26 * GIB;

/// Free memory that should suffice for SP1's own shard size, twice as much again. 23 GiB do not: the kernel killed the claim that takes
/// 22.6 GiB at half the size.
const LARGE: u64 = 48 * GIB;

impl ProverOptions {
    /// Bytes for a compressed proof of any length under the smallest options, because SP1 proves one shard while it recurses over another.
    /// A claim of 7.4 M cycles peaked at 19.7 GiB. Smaller shards do not help: recursion alone takes 14 GiB.
    pub const NEEDED: u64 = 20 * GIB;

    /// The options for `resources`; the error names the missing memory.
    pub fn choose(resources: Resources) -> Result<Self, OptionsError> {
        let Resources { memory, cores } = resources;
        let small = Self {
            element_threshold: 96 << 20,
            height_threshold: 1 << 20,
            workers: 1,
        };
        let middle = Self {
            element_threshold: 192 << 20,
            height_threshold: 2 << 20,
            ..small
        };
        let large = Self {
            element_threshold: sp1_core_executor::ELEMENT_THRESHOLD,
            height_threshold: sp1_core_executor::HEIGHT_THRESHOLD,
            ..small
        };
        match memory {
            0..Self::NEEDED => Err(OptionsError::TooLittleMemory {
                needed: Self::NEEDED,
                free: memory,
            }),
            _ if memory < MIDDLE => Ok(small),
            _ if memory < LARGE => Ok(middle),
            _ if memory < 96 * GIB || cores < 8 => Ok(large),
            _ => Ok(Self {
                workers: 4,
                ..large
            }),
        }
    }

    /// SP1's core options with these thresholds. SP1's variables `ELEMENT_THRESHOLD` and `HEIGHT_THRESHOLD` take precedence.
    pub fn core(&self) -> SP1CoreOpts {
        let mut options = SP1CoreOpts::default();
        let sharding = &mut options.sharding_threshold;
        for (variable, threshold, ours) in [
            (
                "ELEMENT_THRESHOLD",
                &mut sharding.element_threshold,
                self.element_threshold,
            ),
            (
                "HEIGHT_THRESHOLD",
                &mut sharding.height_threshold,
                self.height_threshold,
            ),
        ] {
            if std::env::var_os(variable).is_none() {
                *threshold = ours;
            }
        }
        options
    }

    /// Sets the environment variables for the workers and buffer slots of SP1's prover. The operator's values stay.
    pub fn export(&self) {
        for (variable, per_worker) in WORKERS {
            let name = format!("SP1_WORKER_{variable}");
            if std::env::var_os(&name).is_none() {
                std::env::set_var(name, (self.workers * per_worker).to_string());
            }
        }
    }
}

/// SP1's variables, and their counts per worker.
const WORKERS: [(&str, usize); 18] = [
    ("NUM_SPLICING_WORKERS", 1),
    ("SPLICING_BUFFER_SIZE", 1),
    ("NUMBER_OF_SEND_SPLICE_WORKERS_PER_SPLICE", 1),
    ("SEND_SPLICE_INPUT_BUFFER_SIZE_PER_SPLICE", 1),
    ("GLOBAL_MEMORY_BUFFER_SIZE", 2),
    ("NUM_CORE_WORKERS", 1),
    ("CORE_BUFFER_SIZE", 1),
    ("NUM_SETUP_WORKERS", 1),
    ("SETUP_BUFFER_SIZE", 1),
    ("NORMALIZE_PROGRAM_CACHE_SIZE", 1),
    ("NUM_PREPARE_REDUCE_WORKERS", 1),
    ("PREPARE_REDUCE_BUFFER_SIZE", 1),
    ("NUM_RECURSION_EXECUTOR_WORKERS", 1),
    ("RECURSION_EXECUTOR_BUFFER_SIZE", 1),
    ("NUM_RECURSION_PROVER_WORKERS", 1),
    ("RECURSION_PROVER_BUFFER_SIZE", 1),
    ("NUM_DEFERRED_WORKERS", 1),
    ("DEFERRED_BUFFER_SIZE", 1),
];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn too_little_memory_says_how_much_is_needed() {
        let resources = Resources {
            memory: 8 * GIB,
            cores: 2,
        };
        let error = ProverOptions::choose(resources).unwrap_err();
        assert_eq!(
            error,
            OptionsError::TooLittleMemory {
                needed: ProverOptions::NEEDED,
                free: 8 * GIB
            }
        );
        let text = error.to_string();
        assert!(
            text.contains("needs 20.0 GiB") && text.contains("8.0 GiB are free"),
            "{text}"
        );
    }

    #[test]
    fn options_never_shrink_as_memory_grows() {
        let options = |gib, cores| {
            ProverOptions::choose(Resources {
                memory: gib * GIB,
                cores,
            })
            .unwrap()
        };
        assert_eq!(options(20, 2).workers, 1);
        let sizes = [20, 25, 26, 47, 48, 95].map(|gib| options(gib, 64).element_threshold);
        assert_eq!(sizes[0], sizes[1], "24 GiB have to do for any claim");
        assert!(sizes.is_sorted() && sizes[1] < sizes[2] && sizes[3] < sizes[4]);
        assert_eq!(
            options(200, 2).workers,
            1,
            "two cores gain nothing from four"
        );
        assert_eq!(options(200, 32).workers, 4);
    }

    #[test]
    fn meminfo_is_read_in_kibibytes() {
        let text = "MemTotal:       24612344 kB\nMemFree:  1 kB\nMemAvailable:   22000000 kB\n";
        assert_eq!(bytes_of("MemAvailable:", text), Some(22_000_000 * 1024));
        assert_eq!(bytes_of("MemAvailable:", "MemTotal: 1 kB\n"), None);
        assert_eq!(bytes_of("MemAvailable:", "MemAvailable: lots\n"), None);
    }
}
