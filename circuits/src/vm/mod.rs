//! What the native machine and the SP1 guest compute alike, each in its own way: hashing, and the values that are hashed.

pub mod budget;
pub mod digest;
pub mod merkle;
pub mod poseidon2;
#[cfg(target_os = "zkvm")]
mod system_calls;
pub mod values;
