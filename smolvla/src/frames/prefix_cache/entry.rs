//! A sample as bytes and back. Numbers are little-endian; `f32` keep their bits.
//!
//! `magic (8) | key (32) | length of the payload (8) | SHA-256 of the payload (32) | payload`

use sha2::{Digest, Sha256};

use crate::frames::prefix_cache::key::CacheKey;
use crate::frames::sample::{ObservedSample, PreparedSample};

const MAGIC: &[u8; 8] = b"ZK0PFX01";
const HEADER: usize = 8 + 32 + 8 + 32;

/// A sample that can be cached.
pub trait CacheEntry: Sized {
    /// Its name in keys and entries.
    const KIND: &'static str;

    /// Writes the whole sample.
    fn write(&self, out: &mut EntryWriter);

    /// Reads what [`Self::write`] wrote.
    ///
    /// # Errors
    /// The missing part.
    fn read(from: &mut EntryReader) -> Result<Self, String>;
}

impl CacheEntry for PreparedSample {
    const KIND: &'static str = "prepared";

    fn write(&self, out: &mut EntryWriter) {
        out.number(self.prefix_tokens);
        for layers in [&self.keys, &self.values] {
            out.number(layers.len());
            layers.iter().for_each(|layer| out.numbers(layer));
        }
        out.numbers(&self.actions);
        out.flags(&self.is_pad);
    }

    fn read(from: &mut EntryReader) -> Result<Self, String> {
        let prefix_tokens = from.number()?;
        let mut layers = || -> Result<Vec<Vec<f32>>, String> {
            let count = from.number()?;
            (0..count).map(|_| from.numbers()).collect()
        };
        Ok(Self {
            prefix_tokens,
            keys: layers()?,
            values: layers()?,
            actions: from.numbers()?,
            is_pad: from.flags()?,
        })
    }
}

impl CacheEntry for ObservedSample {
    const KIND: &'static str = "observed";

    fn write(&self, out: &mut EntryWriter) {
        self.observed.write(out);
        out.numbers(&self.state);
    }

    fn read(from: &mut EntryReader) -> Result<Self, String> {
        Ok(Self {
            observed: PreparedSample::read(from)?,
            state: from.numbers()?,
        })
    }
}

/// An entry's bytes.
pub fn encode<E: CacheEntry>(key: &CacheKey, sample: &E) -> Vec<u8> {
    let mut out = EntryWriter(vec![0; HEADER]);
    out.text(E::KIND);
    sample.write(&mut out);
    let mut bytes = out.0;
    let (header, payload) = bytes.split_at_mut(HEADER);
    header[..8].copy_from_slice(MAGIC);
    header[8..40].copy_from_slice(&key.0);
    header[40..48].copy_from_slice(&(payload.len() as u64).to_le_bytes());
    header[48..].copy_from_slice(&Sha256::digest(payload));
    bytes
}

/// An entry's sample. `checked`: the checksum is known to be right.
///
/// # Errors
/// The entry is damaged, or not of `key`.
pub fn decode<E: CacheEntry>(key: &CacheKey, bytes: &[u8], checked: bool) -> Result<E, String> {
    let Some((header, payload)) = bytes.split_at_checked(HEADER) else {
        return Err(format!("it has {} bytes, not even a header", bytes.len()));
    };
    if &header[..8] != MAGIC {
        return Err("it is no entry of this version".into());
    }
    if header[8..40] != key.0 {
        return Err("it is of another frame".into());
    }
    if header[40..48] != (payload.len() as u64).to_le_bytes() {
        return Err(format!("it is cut off after {} bytes", bytes.len()));
    }
    if !checked && header[48..] != Sha256::digest(payload)[..] {
        return Err("its checksum is wrong".into());
    }
    let mut from = EntryReader(payload);
    let kind = from.text()?;
    if kind != E::KIND {
        return Err(format!(
            "it is a sample of kind `{kind}`, not `{}`",
            E::KIND
        ));
    }
    let sample = E::read(&mut from)?;
    match from.0 {
        [] => Ok(sample),
        rest => Err(format!("{} bytes are left over", rest.len())),
    }
}

/// Writes a sample's parts one after another.
pub struct EntryWriter(Vec<u8>);

impl EntryWriter {
    /// A count.
    pub fn number(&mut self, n: usize) {
        self.0.extend((n as u64).to_le_bytes());
    }

    /// A row of numbers.
    pub fn numbers(&mut self, values: &[f32]) {
        self.number(values.len());
        self.0.reserve(4 * values.len());
        for value in values {
            self.0.extend_from_slice(&value.to_le_bytes());
        }
    }

    /// A row of flags.
    pub fn flags(&mut self, values: &[bool]) {
        self.number(values.len());
        self.0.extend(values.iter().map(|flag| u8::from(*flag)));
    }

    fn text(&mut self, text: &str) {
        self.number(text.len());
        self.0.extend(text.as_bytes());
    }
}

/// Reads the parts again, without trust in any length.
pub struct EntryReader<'a>(&'a [u8]);

impl<'a> EntryReader<'a> {
    fn take(&mut self, count: usize) -> Result<&'a [u8], String> {
        let (taken, rest) = self
            .0
            .split_at_checked(count)
            .ok_or_else(|| format!("{count} bytes are promised, {} are there", self.0.len()))?;
        self.0 = rest;
        Ok(taken)
    }

    /// A count.
    ///
    /// # Errors
    /// It is missing.
    pub fn number(&mut self) -> Result<usize, String> {
        let bytes = self.take(8)?;
        let n = bytes
            .iter()
            .rev()
            .fold(0, |n, byte| n << 8 | u64::from(*byte));
        usize::try_from(n).map_err(|_| format!("a count of {n}"))
    }

    /// A row of numbers.
    ///
    /// # Errors
    /// The row is too short.
    pub fn numbers(&mut self) -> Result<Vec<f32>, String> {
        let count = self.number()?;
        let bytes = self.take(
            count
                .checked_mul(4)
                .ok_or_else(|| format!("a count of {count}"))?,
        )?;
        let numbers = bytes.chunks_exact(4);
        Ok(numbers
            .map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]]))
            .collect())
    }

    /// A row of flags.
    ///
    /// # Errors
    /// The row is too short.
    pub fn flags(&mut self) -> Result<Vec<bool>, String> {
        let count = self.number()?;
        Ok(self.take(count)?.iter().map(|byte| *byte != 0).collect())
    }

    fn text(&mut self) -> Result<String, String> {
        let count = self.number()?;
        Ok(String::from_utf8_lossy(self.take(count)?).into_owned())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn sample() -> PreparedSample {
        PreparedSample {
            prefix_tokens: 3,
            keys: vec![vec![1.5, -0.0, f32::MIN_POSITIVE / 2.0], vec![2.0]],
            values: vec![vec![], vec![f32::MAX]],
            actions: vec![0.1, 0.2],
            is_pad: vec![true, false, true],
        }
    }

    const KEY: CacheKey = CacheKey([7; 32]);

    #[test]
    fn samples_come_back_bit_for_bit() {
        let bytes = encode(&KEY, &sample());
        let back: PreparedSample = decode(&KEY, &bytes, false).unwrap();
        assert_eq!(back, sample());
        assert_eq!(back.keys[0][1].to_bits(), (-0.0f32).to_bits());
        let observed = ObservedSample {
            observed: sample(),
            state: vec![0.25],
        };
        let bytes = encode(&KEY, &observed);
        let back: ObservedSample = decode(&KEY, &bytes, false).unwrap();
        assert_eq!(back, observed);
        let error = decode::<PreparedSample>(&KEY, &bytes, false).unwrap_err();
        assert!(error.contains("kind `observed`"), "{error}");
        let error = decode::<ObservedSample>(&CacheKey([8; 32]), &bytes, false).unwrap_err();
        assert!(error.contains("another frame"), "{error}");
    }

    proptest! {
        #[test]
        fn a_damaged_entry_is_noticed(at in 0usize..1000, bit in 0u8..8, cut: bool) {
            let mut bytes = encode(&KEY, &sample());
            let at = at % bytes.len();
            if cut {
                bytes.truncate(at);
            } else {
                bytes[at] ^= 1 << bit;
            }
            prop_assert!(decode::<PreparedSample>(&KEY, &bytes, false).is_err());
            // With an unchecked checksum, the worst case is another sample.
            let _ = decode::<PreparedSample>(&KEY, &bytes, true);
        }
    }
}
