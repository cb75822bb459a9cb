//! The weights that the evaluation does not read: the rows of `action_out_proj` beyond the real action dimensions, and their biases.
//!
//! The loss does not depend on them, so that no proof is about them. But sampling does: each step of the flow feeds all action
//! dimensions back into the expert. Hence an update has to leave them as the base has them, and a round's result takes them from the
//! base. A round can therefore change nothing that nobody evaluated.
//!
//! **The rule**: at the update's scale, each such value is the base's number, rounded to the nearest, ties to even. The scales may
//! differ, because the largest weight of the tensor, which the evaluation may well read, decides it. An honest node keeps the rule by
//! putting the base's numbers back before it quantises: quantising rounds in this way. A cheat can choose nothing, because the base
//! and the scale fix every value. What a coarser scale rounds away in one update is not lost, because the result takes the base's numbers
//! and not the update's; only if the result's own scale is coarser than the base's are they rounded, once, to its nearest step.

use crate::error::WeightFileError;
use crate::format::{Format, WeightsFile};
use crate::scale::{exact, rescaled};
use crate::stretch::TensorStretch;
use zk0_circuits::QuantisedWeights;
use zk0_tensors::ReadAt;

/// What the base weights of a round hold where the evaluation does not read.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Unread(Vec<UnreadValues>);

/// The values of one stretch.
#[derive(Clone, Debug, PartialEq, Eq)]
struct UnreadValues {
    stretch: TensorStretch,
    values: Vec<i16>,
    bits: i16,
}

/// A weight that the evaluation does not read, and that differs from the base's.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Changed {
    /// The tensor, counted from 0 in the order of [`Format::tensors`].
    pub number: u32,
    /// Its name.
    pub name: String,
    /// The element, in row-major order.
    pub index: u64,
    /// Its value.
    pub found: i16,
    /// The base's number at the same scale, which may be too large for it.
    pub expected: i64,
    /// The scale: the tensor's fraction bits.
    pub bits: i16,
}

impl Unread {
    /// Reads what a round's base holds there.
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

    /// Checks that `update` has left all of it as it was.
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

    /// Whether tensor number `tensor` has such weights.
    pub fn concerns(&self, tensor: usize) -> bool {
        self.0.iter().any(|kept| kept.stretch.tensor == tensor)
    }

    /// Puts the base's numbers into tensor number `tensor`, whose values are the fractions `numerators / divisor` in units of 2^−24.
    pub fn restore(&self, tensor: usize, numerators: &mut [i128], divisor: i128) {
        for kept in self.0.iter().filter(|kept| kept.stretch.tensor == tensor) {
            let targets = numerators[kept.stretch.from..].iter_mut();
            for (target, &value) in targets.zip(&kept.values) {
                *target = i128::from(exact(value, kept.bits)) * divisor;
            }
        }
    }
}
