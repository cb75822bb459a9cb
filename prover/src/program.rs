//! The guest program's ELF. Its verifying key, which is all that a verifier needs, is in [`zk0_circuits::program`].

/// The program of mode `direct`, as `circuits/build-guest.sh` builds it.
pub const DIRECT_ELF: &[u8] = include_bytes!("../../circuits/elf/direct.elf");
/// The program of mode `checked`.
pub const CHECKED_ELF: &[u8] = include_bytes!("../../circuits/elf/checked.elf");
