//! The expert's weights as int16 tensors. Their power-of-two scales follow from the weights by a fixed rule.

use crate::model::layout::{expert_tensors, Layout, TensorSpec};
use crate::model::linear::bit_limits;
use crate::model::mode::Mode;
use crate::model::quantise::{quantise_into, weight_bits, QuantiseError};
use crate::model::spec::EvalSpec;
use crate::vm::digest::{tagged_sha256, Digest};
use crate::vm::poseidon2::{hash, Domain};
use crate::vm::values::Values;
use alloc::vec::Vec;

/// All weights of the expert as int16.
///
/// One buffer holds first the fraction bits of each tensor, then the tensors' values, both in the order of
/// [`expert_tensors`]. A tensor has as many fraction bits as possible, up to [`crate::model::layout::MAX_WEIGHT_BITS`], while its
/// largest magnitude still rounds to an int16 (−32767 ..= 32767; ties to even).
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct QuantisedWeights {
    pub(crate) values: Values,
}

/// Why a buffer does not hold quantised weights.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum WeightsError {
    /// Wrong size.
    #[error(
        "quantised weights take {expected} bytes with zeros as padding; there are {found} bytes"
    )]
    Length {
        /// Bytes needed.
        expected: usize,
        /// Bytes there.
        found: usize,
    },
    /// A scale out of bounds.
    #[error("tensor {index} has {bits} fraction bits; it must have {least} to {most}")]
    Scale {
        /// Which tensor, in canonical order.
        index: usize,
        /// Its fraction bits.
        bits: i16,
        /// Least allowed at the specification's scales.
        least: i16,
        /// Most allowed.
        most: i16,
    },
}

impl QuantisedWeights {
    /// Quantises the tensors that `get` returns by name.
    pub fn quantise<'a>(
        spec: &EvalSpec,
        get: impl Fn(&str) -> Option<&'a [f32]>,
    ) -> Result<Self, QuantiseError> {
        spec.validate()?;
        let tensors = expert_tensors(&spec.dims);
        let layout = Layout::new(&spec.dims);
        // Sizes are checked before the buffer is allocated, so that it is never larger than what was given.
        for tensor in &tensors {
            let found =
                get(&tensor.name).ok_or_else(|| QuantiseError::Missing(tensor.name.clone()))?;
            let (expected, found) = (tensor.len(), found.len());
            if expected != found {
                let name = tensor.name.clone();
                return Err(QuantiseError::Length {
                    name,
                    expected,
                    found,
                });
            }
        }
        let quantiser = Quantiser {
            limits: bit_limits(spec, tensors.len()),
            tensors,
        };
        let mut values = Values::zeros(layout.len);
        let all = values.as_mut_slice();
        for (index, place) in layout.tensors.iter().enumerate() {
            let source = get(&quantiser.tensors[index].name).unwrap_or_default();
            all[index] = quantiser.quantise(index, source, &mut all[place.start..][..place.len])?;
        }
        Ok(Self { values })
    }

    /// Reads the bytes of [`Self::as_bytes`].
    pub fn from_bytes(spec: &EvalSpec, bytes: &[u8]) -> Result<Self, WeightsError> {
        let layout = Layout::new(&spec.dims);
        let values = Values::from_bytes(bytes, layout.len).ok_or(WeightsError::Length {
            expected: Values::byte_len(layout.len),
            found: bytes.len(),
        })?;
        let scales = &values.as_slice()[..layout.tensors.len()];
        check_bits(spec, scales)?;
        Ok(Self { values })
    }

    /// Little-endian int16: scales, values, zero padding to a multiple of 8 bytes.
    pub fn as_bytes(&self) -> &[u8] {
        self.values.as_bytes()
    }

    /// The values of tensor number `index`, row-major, and their fraction bits.
    pub fn tensor(&self, layout: &Layout, index: usize) -> (&[i16], i16) {
        let values = self.values.as_slice();
        let place = layout.tensors[index];
        (&values[place.start..][..place.len], values[index])
    }

    /// Digest over scales and values: [`crate::WeightsDigest::quantised`]. It is Poseidon2 in mode `direct`, where the guest
    /// computes it. It is SHA-256 in mode `succinct`, where only verifiers compute it, because that takes a tenth of the time.
    pub fn digest(&self, mode: Mode) -> Digest {
        match mode {
            Mode::Direct => hash(Domain::Weights, &self.values),
            Mode::Succinct => succinct_digest(self.as_bytes()),
        }
    }
}

/// [`QuantisedWeights::digest`] in mode `succinct`, of [`QuantisedWeights::as_bytes`].
pub fn succinct_digest(bytes: &[u8]) -> Digest {
    tagged_sha256("zk0/quantised/v1", &[bytes])
}

/// Quantises the expert's tensors one at a time.
pub struct Quantiser {
    tensors: Vec<TensorSpec>,
    limits: Vec<(i16, i16)>,
}

impl Quantiser {
    /// Prepares to quantise the tensors of a valid specification.
    pub fn new(spec: &EvalSpec) -> Self {
        let tensors = expert_tensors(&spec.dims);
        let limits = bit_limits(spec, tensors.len());
        Self { tensors, limits }
    }

    /// The tensors, in canonical order.
    pub fn tensors(&self) -> &[TensorSpec] {
        &self.tensors
    }

    /// Quantises tensor number `index` into `target`, which is as long; returns its fraction bits.
    pub fn quantise(
        &self,
        index: usize,
        source: &[f32],
        target: &mut [i16],
    ) -> Result<i16, QuantiseError> {
        let name = &self.tensors[index].name;
        let bits = weight_bits(name, source, self.limits[index])?;
        quantise_into(name, source, bits as u32, target)?;
        Ok(bits)
    }
}

/// Checks the fraction bits of all tensors.
fn check_bits(spec: &EvalSpec, scales: &[i16]) -> Result<(), WeightsError> {
    let limits = bit_limits(spec, scales.len());
    for (index, (&bits, (least, most))) in scales.iter().zip(limits).enumerate() {
        if !(least..=most).contains(&bits) {
            return Err(WeightsError::Scale {
                index,
                bits,
                least,
                most,
            });
        }
    }
    Ok(())
}
