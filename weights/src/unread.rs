//! The weights that the evaluation does not read: the rows of `action_out_proj` beyond the real action dimensions, and their biases.
//!
//! The loss does not depend on them, so no proof covers them. But each step of the flow feeds all action dimensions back into the expert.
//! So an update must keep the base's values there, and a round's result takes them from the base: nothing changes that was not evaluated.
//!
//! **The rule**: at the update's scale, each such value is the base's number, rounded to the nearest, ties to even. The scales may differ,
//! because the tensor's largest weight decides them. An honest node puts the base's numbers back before it quantises. Base and scale fix
//! every value. The result takes the base's numbers, so a coarser update loses nothing; they are rounded, once, only if the result's scale
//! is coarser than the base's.

use crate::error::WeightFileError;
use crate::format::{Format, WeightsFile};
use crate::scale::{exact, rescaled};
use crate::stretch::TensorStretch;
use zk0_circuits::QuantisedWeights;
use zk0_tensors::ReadAt;

/// A round's base where the evaluation does not read.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Unread(Vec<UnreadValues>);

#[derive(Clone, Debug, PartialEq, Eq)]
struct UnreadValues {
    stretch: TensorStretch,
    values: Vec<i16>,
    bits: i16,
}

/// An unread weight that differs from the base's.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Changed {
    /// The tensor's number, from 0, as in [`Format::tensors`].
    pub number: u32,
    /// Its name.
    pub name: String,
    /// The element, in row-major order.
    pub index: u64,
    /// Its value.
    pub found: i16,
    /// The base's number at this scale; it may exceed int16.
    pub expected: i64,
    /// The tensor's fraction bits.
    pub bits: i16,
}

impl Unread {
    /// Reads them from a round's base.
    ///
    /// # Errors
    /// The file cannot be read.
    pub fn of<R: ReadAt>(
        format: &Format,
        base: &WeightsFile<'_, R>,
    ) -> Result<Self, WeightFileError> {
        let kept = format.unread().iter().map(|&stretch| {
            let mut tensor = base.tensor(stretch.tensor)?;
            Ok::<_, WeightFileError>(UnreadValues {
                stretch,
                values: tensor.values.split_off(stretch.from),
                bits: tensor.bits,
            })
        });
        Ok(Self(kept.collect::<Result<_, _>>()?))
    }

    /// Checks that `update` has not changed them.
    ///
    /// # Errors
    /// The first weight that differs.
    pub fn check(&self, format: &Format, update: &QuantisedWeights) -> Result<(), Changed> {
        for kept in &self.0 {
            let TensorStretch { tensor, from } = kept.stretch;
            let (values, bits) = format.tensor(update, tensor);
            let pairs = values[from..].iter().zip(&kept.values);
            for (index, (&found, &base)) in pairs.enumerate() {
                let expected = rescaled(base, kept.bits, bits);
                if i64::from(found) != expected {
                    return Err(Changed {
                        number: tensor as u32,
                        name: format.tensors()[tensor].name.clone(),
                        index: (from + index) as u64,
                        found,
                        expected,
                        bits,
                    });
                }
            }
        }
        Ok(())
    }

    /// Whether the tensor has such weights.
    pub fn concerns(&self, tensor: usize) -> bool {
        self.0.iter().any(|kept| kept.stretch.tensor == tensor)
    }

    /// Puts the base's numbers into a tensor of the values `numerators / divisor`, in units of 2^−24.
    pub fn restore(&self, tensor: usize, numerators: &mut [i128], divisor: i128) {
        for kept in self.0.iter().filter(|kept| kept.stretch.tensor == tensor) {
            let targets = numerators[kept.stretch.from..].iter_mut();
            for (target, &value) in targets.zip(&kept.values) {
                *target = i128::from(exact(value, kept.bits)) * divisor;
            }
        }
    }
}
