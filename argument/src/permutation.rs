//! Poseidon2 over KoalaBear, sixteen values wide: SP1's precompile in the guest, and the same permutation natively.
//!
//! The guest program links `sp1-zkvm`, which defines the system call. This crate only declares it. `zk0_circuits` declares it too, but keeps
//! it to itself: making it public would change the programs that are built of that crate.

#[cfg(not(target_os = "zkvm"))]
pub use zk0_circuits::vm::poseidon2::{permute, State};

#[cfg(target_os = "zkvm")]
pub use guest::{permute, State};

#[cfg(target_os = "zkvm")]
mod guest {
    /// Sixteen canonical KoalaBear values, two to a word, the first in the low half.
    #[derive(Default)]
    #[repr(C)]
    pub struct State(pub [u64; 8]);

    extern "C" {
        fn syscall_poseidon2(state: *mut State);
    }

    /// One permutation. Every value of `state` must be below the modulus, or no proof can be made of the run.
    #[inline(always)]
    pub fn permute(state: &mut State) {
        // SAFETY: the precompile reads and writes exactly this 64-byte, 8-aligned block.
        unsafe { syscall_poseidon2(state) }
    }
}
