//! The guest programs' ELFs. Their verifying keys are in [`zk0_circuits::claim::program`].

use zk0_circuits::claim::program::verifying_keys;
use zk0_circuits::Mode;

/// This release does not carry a guest program.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "it is zk0 {}, which lacks the guest program {}: install the release of zk0 there that has it",
    env!("CARGO_PKG_VERSION"),
    hex::encode(.0)
)]
pub struct LacksProgram(pub Vec<u8>);

/// The ELFs of the programs of `mode`, built by `circuits/build-guest.sh`, in the order of [`verifying_keys`].
pub fn elfs(mode: Mode) -> &'static [&'static [u8]] {
    match mode {
        Mode::Direct => &[include_bytes!("../../../circuits/elf/direct.elf")],
        Mode::Succinct => &[include_bytes!("../../../circuits/elf/succinct.elf")],
    }
}

/// The ELF of this release's own program of `mode`.
pub fn elf(mode: Mode) -> &'static [u8] {
    elfs(mode)[0]
}

/// The programs of `mode` that this release carries, each with its verifying key.
pub(crate) fn carried(mode: Mode) -> impl Iterator<Item = (&'static [u8; 32], &'static [u8])> {
    let keys = verifying_keys(mode).iter().copied();
    keys.zip(elfs(mode).iter().copied())
}

/// The ELF of the program of `mode` with this verifying key.
pub(crate) fn elf_of(mode: Mode, key: &[u8]) -> Result<&'static [u8], LacksProgram> {
    let found = carried(mode).find(|(ours, _)| ours[..] == *key);
    let (_, elf) = found.ok_or_else(|| {
        // A request may name more bytes than a key has.
        LacksProgram(key.iter().copied().take(32).collect())
    })?;
    Ok(elf)
}
