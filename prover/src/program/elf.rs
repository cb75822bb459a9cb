//! The ELFs of the guest programs. Their verifying keys, which are all that a verifier needs, are in
//! [`zk0_circuits::claim::program`].

use zk0_circuits::Mode;

/// The ELF of the program of `mode`, as `circuits/build-guest.sh` builds it.
pub fn elf(mode: Mode) -> &'static [u8] {
    match mode {
        Mode::Direct => include_bytes!("../../../circuits/elf/direct.elf"),
        Mode::Succinct => include_bytes!("../../../circuits/elf/succinct.elf"),
    }
}
