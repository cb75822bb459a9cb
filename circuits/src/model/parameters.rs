//! Norm gains and biases: the small tensors of the expert, which enter the guest in every mode.

use crate::model::layout::Layout;
use crate::model::quantise::QuantiseError;
use crate::model::spec::EvalSpec;
use crate::model::weights::{check_bits, QuantisedWeights, Quantiser, WeightsError};
use crate::vm::digest::Digest;
use crate::vm::poseidon2::{hash, Domain};
use crate::vm::values::Values;
use alloc::vec::Vec;

/// Norm gains and biases as int16: first the fraction bits of each, then their values, in the order of
/// [`crate::model::layout::expert_tensors`].
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Parameters {
    values: Values,
    /// For each tensor of the expert where it lies here; `None` for a matrix.
    places: Vec<Option<Place>>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Place {
    bits: usize,
    start: usize,
    len: usize,
}

/// A gain or bias.
#[derive(Clone, Copy, Debug)]
pub struct Vector<'a> {
    /// The values.
    pub values: &'a [i16],
    /// Their fraction bits.
    pub bits: i16,
}

impl Parameters {
    /// Copies the gains and biases of `weights`, which were quantised for `spec`.
    pub fn of(spec: &EvalSpec, weights: &QuantisedWeights) -> Self {
        let layout = Layout::new(&spec.dims);
        let (places, len) = places(&layout);
        let mut values = Values::zeros(len);
        let all = values.as_mut_slice();
        for (index, place) in places.iter().enumerate() {
            if let Some(place) = place {
                let (source, bits) = weights.tensor(&layout, index);
                all[place.bits] = bits;
                all[place.start..][..place.len].copy_from_slice(source);
            }
        }
        Self { values, places }
    }

    /// Quantises the gains and biases that `get` returns by name.
    pub fn quantise<'t>(
        quantiser: &Quantiser,
        spec: &EvalSpec,
        get: impl Fn(&str) -> Option<&'t [f32]>,
    ) -> Result<Self, QuantiseError> {
        let (places, len) = places(&Layout::new(&spec.dims));
        let mut values = Values::zeros(len);
        let all = values.as_mut_slice();
        for (index, (tensor, place)) in quantiser.tensors().iter().zip(&places).enumerate() {
            let Some(place) = place else { continue };
            let missing = || QuantiseError::Missing(tensor.name.clone());
            let source = get(&tensor.name).ok_or_else(missing)?;
            if source.len() != place.len {
                return Err(QuantiseError::Length {
                    name: tensor.name.clone(),
                    expected: place.len,
                    found: source.len(),
                });
            }
            all[place.bits] =
                quantiser.quantise(index, source, &mut all[place.start..][..place.len])?;
        }
        Ok(Self { values, places })
    }

    /// Reads the bytes of [`Self::as_bytes`].
    pub fn from_bytes(spec: &EvalSpec, bytes: &[u8]) -> Result<Self, WeightsError> {
        let (places, len) = places(&Layout::new(&spec.dims));
        let values = Values::from_bytes(bytes, len).ok_or(WeightsError::Length {
            expected: Values::byte_len(len),
            found: bytes.len(),
        })?;
        let all = values.as_slice();
        let bits = places
            .iter()
            .map(|place| place.map(|place| all[place.bits]));
        check_bits(spec, bits)?;
        Ok(Self { values, places })
    }

    /// Little-endian int16, zero-padded to a multiple of 8 bytes.
    pub fn as_bytes(&self) -> &[u8] {
        self.values.as_bytes()
    }

    /// Poseidon2 digest.
    pub fn digest(&self) -> Digest {
        hash(Domain::Parameters, &self.values)
    }

    /// Returns the gain or bias that is number `index` of the expert's tensors. It is empty for a matrix.
    pub fn vector(&self, index: usize) -> Vector<'_> {
        let values = self.values.as_slice();
        match self.places.get(index) {
            Some(Some(place)) => Vector {
                values: &values[place.start..][..place.len],
                bits: values[place.bits],
            },
            _ => Vector {
                values: &[],
                bits: 0,
            },
        }
    }
}

fn places(layout: &Layout) -> (Vec<Option<Place>>, usize) {
    let vectors = layout.tensors.iter().filter(|tensor| !tensor.is_matrix);
    let (mut bits, mut start) = (0, vectors.count());
    let places = layout
        .tensors
        .iter()
        .map(|tensor| {
            if tensor.is_matrix {
                return None;
            }
            let place = Place {
                bits,
                start,
                len: tensor.len,
            };
            bits += 1;
            start += tensor.len;
            Some(place)
        })
        .collect();
    (places, start)
}
