//! Int16 values kept in 8-byte words.
//!
//! Weights and samples are hashed four values at a time and multiplied one at a time. As `u64` words they need no copy for
//! either, because such an allocation is always aligned to 8 bytes.

use alloc::vec;
use alloc::vec::Vec;

#[cfg(target_endian = "big")]
compile_error!("values are kept as little-endian words: zk0 runs on little-endian machines only");

/// A list of int16 values; its bytes are the values in little-endian order, zero-padded to a multiple of 8.
#[derive(Clone, PartialEq, Eq)]
pub struct Values {
    words: Vec<u64>,
    len: usize,
}

impl Values {
    /// `len` zeros.
    pub fn zeros(len: usize) -> Self {
        Self {
            words: vec![0; len.div_ceil(4)],
            len,
        }
    }

    /// Copies `values`.
    pub fn from_slice(values: &[i16]) -> Self {
        let mut all = Self::zeros(values.len());
        all.as_mut_slice().copy_from_slice(values);
        all
    }

    /// Reads `len` values from exactly [`Self::byte_len`] bytes. Returns `None` if the length differs or the padding is not 0.
    pub fn from_bytes(bytes: &[u8], len: usize) -> Option<Self> {
        if bytes.len() != Self::byte_len(len) {
            return None;
        }
        let mut words = vec![0u64; bytes.len() / 8];
        bytemuck::cast_slice_mut::<u64, u8>(&mut words).copy_from_slice(bytes);
        let padding = &bytemuck::cast_slice::<u64, i16>(&words)[len..];
        padding
            .iter()
            .all(|&value| value == 0)
            .then_some(Self { words, len })
    }

    /// Bytes that `len` values take: 2 each, rounded up to a multiple of 8.
    pub fn byte_len(len: usize) -> usize {
        len.div_ceil(4) * 8
    }

    /// The values.
    #[inline]
    pub fn as_slice(&self) -> &[i16] {
        &bytemuck::cast_slice(&self.words)[..self.len]
    }

    /// The values, to be changed.
    pub fn as_mut_slice(&mut self) -> &mut [i16] {
        &mut bytemuck::cast_slice_mut(&mut self.words)[..self.len]
    }

    /// The values four to a word, little-endian, zero-padded.
    #[inline]
    pub fn words(&self) -> &[u64] {
        &self.words
    }

    /// The values as bytes, zero-padded to a multiple of 8.
    pub fn as_bytes(&self) -> &[u8] {
        bytemuck::cast_slice(&self.words)
    }

    /// Number of values.
    pub fn len(&self) -> usize {
        self.len
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }
}

impl core::fmt::Debug for Values {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        write!(f, "Values({} int16)", self.len)
    }
}
