//! The guest programs' ELFs. Their verifying keys are in [`zk0_circuits::claim::program`].

use zk0_circuits::Mode;

/// The ELF for `mode`, built by `circuits/build-guest.sh`.
pub fn elf(mode: Mode) -> &'static [u8] {
    match mode {
        Mode::Direct => include_bytes!("../../../circuits/elf/direct.elf"),
        Mode::Succinct => include_bytes!("../../../circuits/elf/succinct.elf"),
    }
}
