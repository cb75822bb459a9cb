//! Poseidon2 over KoalaBear, width 16, SP1's constants, and its uses: hash of a fixed-length list, sponge of a transcript.

use crate::field::F;

/// Eight field elements: 248 bits, 124 bits against collisions.
pub type Digest = [F; 8];

/// Sixteen elements: eight of rate, eight of capacity.
#[derive(Clone, Debug)]
#[repr(C, align(8))]
pub struct State(pub [F; 16]);

#[cfg(target_os = "zkvm")]
extern "C" {
    fn syscall_poseidon2(state: *mut State);
}

impl State {
    /// Zeros but for the domain and a length in the capacity: what is hashed cannot be taken for something else.
    #[inline(always)]
    pub fn new(domain: u32, length: usize) -> Self {
        let mut state = [F::ZERO; 16];
        state[8] = F(domain);
        state[9] = F(length as u32);
        Self(state)
    }

    /// One permutation: a precompile in the guest. Its constraints refuse inputs that are not canonical.
    #[cfg(target_os = "zkvm")]
    #[inline(always)]
    pub fn permute(&mut self) {
        // SAFETY: the precompile reads and writes exactly this 64-byte, 8-aligned block.
        unsafe { syscall_poseidon2(self) }
    }

    /// One permutation.
    #[cfg(not(target_os = "zkvm"))]
    pub fn permute(&mut self) {
        use slop_algebra::{AbstractField, PrimeField32};
        use slop_koala_bear::{my_kb_16_perm, KoalaBear, KoalaPerm};
        use slop_symmetric::Permutation;
        use std::sync::LazyLock;
        static PERMUTATION: LazyLock<KoalaPerm> = LazyLock::new(my_kb_16_perm);
        let input = self.0.map(|value| KoalaBear::from_canonical_u32(value.0));
        self.0 = PERMUTATION.permute(input).map(|value| F(value.as_canonical_u32()));
    }

    /// Overwrites the rate with up to eight values at a time and permutes after each time.
    #[inline(always)]
    pub fn absorb(&mut self, values: &[F]) {
        let mut blocks = values.chunks_exact(8);
        for block in &mut blocks {
            self.0[..8].copy_from_slice(block);
            self.permute();
        }
        let rest = blocks.remainder();
        if !rest.is_empty() {
            self.0[..rest.len()].copy_from_slice(rest);
            self.permute();
        }
    }

    /// The rate.
    #[inline(always)]
    pub fn digest(&self) -> Digest {
        core::array::from_fn(|i| self.0[i])
    }
}
