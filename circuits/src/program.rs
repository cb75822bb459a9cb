//! The guest programs' verifying keys: all that a verifier needs to know of a program.
//!
//! `circuits/elf/` holds them beside the ELFs, with a record of SP1's version and the toolchain that built them;
//! `circuits/build-guest.sh` builds the ELFs again from source.

/// bincode of the `direct` program's `vk.hash_koalabear()`: what a compressed proof is verified against.
pub const DIRECT_VERIFYING_KEY: [u8; 32] = *include_bytes!("../elf/direct.vk");
/// The same of the `checked` program.
pub const CHECKED_VERIFYING_KEY: [u8; 32] = *include_bytes!("../elf/checked.vk");
