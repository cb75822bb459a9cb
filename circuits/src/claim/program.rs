//! The verifying keys of the guest programs. A verifier needs to know nothing else of a program.
//!
//! `circuits/elf/` holds them beside the ELFs, with a record of SP1's version and the toolchain that built them;
//! `circuits/build-guest.sh` builds the ELFs again from source.

use crate::model::mode::Mode;

/// Returns the bincode of `vk.hash_koalabear()` of the program of `mode`. A compressed proof is verified against it.
pub fn verifying_key(mode: Mode) -> &'static [u8; 32] {
    match mode {
        Mode::Direct => include_bytes!("../../elf/direct.vk"),
        Mode::Succinct => include_bytes!("../../elf/succinct.vk"),
    }
}
