//! One sample: a frame's frozen prefix as per-layer keys and values, its action chunk and pad mask, in fixed point.

use crate::model::quantise::{quantise_into, QuantiseError};
use crate::model::spec::{Dims, EvalSpec};
use crate::vm::digest::Digest;
use crate::vm::poseidon2::{hash, Domain};
use crate::vm::values::Values;
use alloc::format;
use alloc::string::String;

/// A sample. One int16 buffer:
///
/// | values | what |
/// |---|---|
/// | 1 | number of valid prefix tokens |
/// | chunk | pad mask: 0, and 1 from the end of the episode on |
/// | chunk × max_action_dim | normalised actions, row per frame; zeros beyond `action_dim` and in padding |
/// | per layer: prefix × kv_width, twice | the prefix's keys (after RoPE), then its values |
///
/// Where the evaluation reads nothing, a sample holds zeros. So two samples that are the same to the evaluation are the same bytes, and
/// give the same leaf in a dataset.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Sample {
    pub(crate) values: Values,
    prefix: usize,
}

/// The parts of a sample in f32, padded prefix tokens dropped.
#[derive(Clone, Copy, Debug)]
pub struct SampleParts<'a> {
    /// Per layer, keys after RoPE and values, each `[prefix, kv_width]` row-major.
    pub cache: &'a [(&'a [f32], &'a [f32])],
    /// Normalised actions `[chunk, max_action_dim]`.
    pub actions: &'a [f32],
    /// `[chunk]`, true past the end of the episode.
    pub is_pad: &'a [bool],
}

/// Why a buffer does not hold a sample.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum SampleError {
    /// Wrong size for the number of prefix tokens.
    #[error("a sample with {prefix} prefix tokens takes {expected} bytes with zeros as padding; there are {found} bytes")]
    Length {
        /// Prefix tokens.
        prefix: usize,
        /// Bytes needed.
        expected: usize,
        /// Bytes there.
        found: usize,
    },
    /// The sample has no prefix tokens, or too many.
    #[error("a sample has {found} prefix tokens; it must have 1 to {most}")]
    Prefix {
        /// Tokens in the sample.
        found: i64,
        /// Most allowed.
        most: u32,
    },
    /// The pad mask holds another value than 0 and 1.
    #[error("the pad mask of frame {frame} is {value}; it must be 0 or 1")]
    PadMask {
        /// Which frame.
        frame: usize,
        /// The value.
        value: i16,
    },
    /// The first frame is padding, or another frame than the last ones.
    #[error("the pad mask is out of order at frame {frame}: a sample has at least one real frame, and padding only after the last one")]
    PadOrder {
        /// Which frame.
        frame: usize,
    },
    /// There is an action where the evaluation reads none.
    #[error("action dimension {dimension} of frame {frame} is {value}; it must be 0, because it is not read")]
    NotRead {
        /// Which frame.
        frame: usize,
        /// Which action dimension.
        dimension: usize,
        /// The value.
        value: i16,
    },
}

impl Sample {
    /// Quantises a sample at the specification's scales.
    pub fn quantise(spec: &EvalSpec, parts: SampleParts<'_>) -> Result<Self, QuantiseError> {
        spec.validate()?;
        let dims = &spec.dims;
        let (chunk, width) = (dims.chunk as usize, dims.kv_width());
        let wrong = |name: String, expected: usize, found: usize| {
            Err(QuantiseError::Length {
                name,
                expected,
                found,
            })
        };
        if parts.cache.len() != spec.layers.len() {
            return wrong(
                "sample cache (layers)".into(),
                spec.layers.len(),
                parts.cache.len(),
            );
        }
        if parts.is_pad.len() != chunk {
            return wrong("sample pad mask".into(), chunk, parts.is_pad.len());
        }
        if parts.is_pad[0] || !parts.is_pad.is_sorted() {
            return Err(QuantiseError::PadOrder);
        }
        let actions = chunk * dims.max_action_dim as usize;
        if parts.actions.len() != actions {
            return wrong("sample actions".into(), actions, parts.actions.len());
        }
        let prefix = parts.cache[0].0.len() / width;
        if prefix == 0 || prefix > dims.max_prefix as usize {
            return wrong(
                "sample prefix (tokens)".into(),
                dims.max_prefix as usize,
                prefix,
            );
        }
        for (layer, (keys, values)) in parts.cache.iter().enumerate() {
            for (what, found) in [("keys", keys.len()), ("values", values.len())] {
                if found != prefix * width {
                    return wrong(
                        format!("sample {what} of layer {layer}"),
                        prefix * width,
                        found,
                    );
                }
            }
        }
        let mut values = Values::zeros(Self::len(dims, prefix));
        let (header, rest) = values.as_mut_slice().split_at_mut(1 + chunk);
        header[0] = prefix as i16;
        for (flag, &pad) in header[1..].iter_mut().zip(parts.is_pad) {
            *flag = pad as i16;
        }
        let (target, mut rest) = rest.split_at_mut(actions);
        quantise_into("sample actions", parts.actions, spec.action as u32, target)?;
        let read = dims.action_dim as usize;
        for (row, &pad) in target.chunks_exact_mut(actions / chunk).zip(parts.is_pad) {
            row[if pad { 0 } else { read }..].fill(0);
        }
        for (layer, ((keys, cached), scales)) in parts.cache.iter().zip(&spec.layers).enumerate() {
            for (what, source, bits) in [
                ("keys", keys, scales.cache_key),
                ("values", cached, scales.cache_value),
            ] {
                let (target, later) = rest.split_at_mut(prefix * width);
                quantise_into(
                    &format!("sample {what} of layer {layer}"),
                    source,
                    bits as u32,
                    target,
                )?;
                rest = later;
            }
        }
        Ok(Self { values, prefix })
    }

    /// Reads the bytes of [`Self::as_bytes`].
    pub fn from_bytes(dims: &Dims, bytes: &[u8]) -> Result<Self, SampleError> {
        let (sample, rest) = Self::split_from(dims, bytes)?;
        if rest.is_empty() {
            return Ok(sample);
        }
        let prefix = sample.prefix;
        let expected = bytes.len() - rest.len();
        Err(SampleError::Length {
            prefix,
            expected,
            found: bytes.len(),
        })
    }

    /// Reads a sample from the front of `bytes`, and returns what follows it.
    pub fn split_from<'b>(dims: &Dims, bytes: &'b [u8]) -> Result<(Self, &'b [u8]), SampleError> {
        let found = match bytes {
            [low, high, ..] => i16::from_le_bytes([*low, *high]) as i64,
            _ => 0,
        };
        if found < 1 || found > dims.max_prefix as i64 {
            return Err(SampleError::Prefix {
                found,
                most: dims.max_prefix,
            });
        }
        let prefix = found as usize;
        let len = Self::len(dims, prefix);
        let expected = Values::byte_len(len);
        let wrong = SampleError::Length {
            prefix,
            expected,
            found: bytes.len(),
        };
        let (bytes, rest) = bytes.split_at_checked(expected).ok_or(wrong.clone())?;
        let values = Values::from_bytes(bytes, len).ok_or(wrong)?;
        let sample = Self { values, prefix };
        sample.check_padding(dims)?;
        Ok((sample, rest))
    }

    /// Checks the pad mask, and that actions which are not read are zero.
    fn check_padding(&self, dims: &Dims) -> Result<(), SampleError> {
        let mask = &self.values.as_slice()[1..];
        let width = dims.max_action_dim as usize;
        let mut padding = false;
        for (frame, actions) in self.actions(dims).chunks_exact(width).enumerate() {
            let value = mask[frame];
            if value >> 1 != 0 {
                return Err(SampleError::PadMask { frame, value });
            }
            let pad = value != 0;
            if (pad && frame == 0) || (padding && !pad) {
                return Err(SampleError::PadOrder { frame });
            }
            padding = pad;
            let read = if pad { 0 } else { dims.action_dim as usize };
            for (dimension, &value) in actions.iter().enumerate().skip(read) {
                if value != 0 {
                    return Err(SampleError::NotRead {
                        frame,
                        dimension,
                        value,
                    });
                }
            }
        }
        Ok(())
    }

    /// Bytes of a sample with `prefix` valid tokens.
    pub fn byte_len(dims: &Dims, prefix: usize) -> usize {
        Values::byte_len(Self::len(dims, prefix))
    }

    /// Little-endian int16, zero-padded to a multiple of 8 bytes.
    pub fn as_bytes(&self) -> &[u8] {
        self.values.as_bytes()
    }

    /// Poseidon2 digest, which goes into the dataset's leaf.
    pub fn digest(&self) -> Digest {
        hash(Domain::Sample, &self.values)
    }

    /// Number of valid prefix tokens.
    pub fn prefix(&self) -> usize {
        self.prefix
    }

    /// Whether `frame` lies past the end of the episode.
    pub fn is_pad(&self, frame: usize) -> bool {
        self.values.as_slice()[1 + frame] != 0
    }

    /// Actions `[chunk, max_action_dim]`.
    pub(crate) fn actions(&self, dims: &Dims) -> &[i16] {
        let chunk = dims.chunk as usize;
        &self.values.as_slice()[1 + chunk..][..chunk * dims.max_action_dim as usize]
    }

    /// Keys and values of `layer`, each `[prefix, kv_width]`.
    pub(crate) fn cache(&self, dims: &Dims, layer: usize) -> (&[i16], &[i16]) {
        let chunk = dims.chunk as usize;
        let each = self.prefix * dims.kv_width();
        let start = 1 + chunk + chunk * dims.max_action_dim as usize + 2 * layer * each;
        self.values.as_slice()[start..start + 2 * each].split_at(each)
    }

    pub(crate) fn len(dims: &Dims, prefix: usize) -> usize {
        let chunk = dims.chunk as usize;
        let cache = 2 * dims.layers as usize * prefix * dims.kv_width();
        1 + chunk + chunk * dims.max_action_dim as usize + cache
    }
}
