//! The verifying keys of the guest programs. A verifier needs to know nothing else of a program.
//!
//! `circuits/elf/` holds them beside the ELFs, with a record of SP1's version and the toolchain that built them;
//! `circuits/build-guest.sh` builds the ELFs again from source.

use crate::model::mode::Mode;

/// The verifying keys of the programs of `mode` that this release carries: its own, and after it those of earlier releases. Each is the
/// bincode of `vk.hash_koalabear()`, against which a compressed proof is verified.
pub fn verifying_keys(mode: Mode) -> &'static [&'static [u8; 32]] {
    match mode {
        Mode::Direct => &[include_bytes!("../../elf/direct.vk")],
        Mode::Succinct => &[include_bytes!("../../elf/succinct.vk")],
    }
}

/// The verifying key of this release's own program of `mode`.
pub fn verifying_key(mode: Mode) -> &'static [u8; 32] {
    verifying_keys(mode)[0]
}

/// Whether this release carries the program of `mode` with this key.
pub fn is_carried(mode: Mode, key: &[u8]) -> bool {
    verifying_keys(mode).iter().any(|ours| ours[..] == *key)
}
