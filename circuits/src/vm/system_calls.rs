//! The SP1 precompiles that hashing uses inside the guest.
//!
//! `sp1-zkvm` defines the system calls, and the guest program links it. This crate only declares them, so that it does not depend
//! on `sp1-zkvm`.

extern "C" {
    fn syscall_sha256_extend(words: *mut [u64; 64]);
    fn syscall_sha256_compress(words: *mut [u64; 64], state: *mut [u64; 8]);
    fn syscall_poseidon2(state: *mut Poseidon2State);
    #[cfg(feature = "budget")]
    fn syscall_write(file: u32, bytes: *const u8, count: usize);
}

/// What the Poseidon2 precompile permutes in place: sixteen canonical KoalaBear values, two to a word, the first in the
/// low half.
#[repr(C)]
pub struct Poseidon2State(pub [u64; 8]);

/// Writes to the executor's standard output.
#[cfg(feature = "budget")]
pub fn print(text: &str) {
    const STDOUT: u32 = 1;
    // SAFETY: the call reads exactly these bytes.
    unsafe { syscall_write(STDOUT, text.as_ptr(), text.len()) }
}

/// One Poseidon2 permutation. Every value of `state` must be below the modulus, or no proof can be made of the run.
#[inline(always)]
pub fn poseidon2(state: &mut Poseidon2State) {
    // SAFETY: the precompile reads and writes exactly this 64-byte, 8-aligned block.
    unsafe { syscall_poseidon2(state) }
}

/// SHA-256 (FIPS 180-4), its message schedule and compression done by precompiles on words widened to 64 bits.
pub struct Sha256 {
    state: [u64; 8],
    block: [u8; 64],
    filled: usize,
    length: u64,
}

impl Sha256 {
    pub fn new() -> Self {
        Self {
            state: [
                0x6a09e667, 0xbb67ae85, 0x3c6ef372, 0xa54ff53a, 0x510e527f, 0x9b05688c, 0x1f83d9ab,
                0x5be0cd19,
            ],
            block: [0; 64],
            filled: 0,
            length: 0,
        }
    }

    pub fn update(&mut self, bytes: &[u8]) {
        self.length += bytes.len() as u64;
        let mut rest = bytes;
        while !rest.is_empty() {
            let (now, later) = rest.split_at(rest.len().min(64 - self.filled));
            self.block[self.filled..self.filled + now.len()].copy_from_slice(now);
            self.filled += now.len();
            rest = later;
            if self.filled == 64 {
                self.compress();
            }
        }
    }

    pub fn finish(mut self) -> [u8; 32] {
        let bits = self.length * 8;
        self.block[self.filled] = 0x80;
        self.block[self.filled + 1..].fill(0);
        if self.filled >= 56 {
            self.compress();
            self.block.fill(0);
        }
        self.block[56..].copy_from_slice(&bits.to_be_bytes());
        self.compress();
        let mut digest = [0; 32];
        for (bytes, word) in digest.chunks_exact_mut(4).zip(self.state) {
            bytes.copy_from_slice(&(word as u32).to_be_bytes());
        }
        digest
    }

    fn compress(&mut self) {
        let mut words = [0u64; 64];
        for (word, bytes) in words.iter_mut().zip(self.block.chunks_exact(4)) {
            *word = u32::from_be_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]) as u64;
        }
        // SAFETY: both arrays are 8-aligned and of the size the precompiles read and write.
        unsafe {
            syscall_sha256_extend(&mut words);
            syscall_sha256_compress(&mut words, &mut self.state);
        }
        self.filled = 0;
    }
}
