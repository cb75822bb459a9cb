//! Tensors that both sides compute, and that the verifier evaluates at a point.

use super::axis::Axis;
use super::part::Part;
use crate::field::{Extension, Goldilocks};
use crate::multilinear::outer;
use alloc::vec::Vec;

/// A tensor that both sides compute.
pub trait Public: Sync {
    /// Its axes, from the lowest.
    fn axes(&self) -> &[Axis];
    /// Its value at these indices, one on each axis.
    fn value(&self, indices: &[usize]) -> Goldilocks;
    /// `Σ_b w(b)·T(b)`, where the weights are a part for each axis.
    fn at(&self, parts: &[&Part]) -> Extension;
    /// Whether [`Self::at`] is quick for points. Others are given all weights, which the verifier has written out for other uses too.
    fn likes_points(&self) -> bool {
        false
    }
}

/// A tensor that is written out.
pub struct Written {
    /// Its axes.
    pub axes: Vec<Axis>,
    /// Bits of each axis.
    pub bits: Vec<u8>,
    /// All values.
    pub values: Vec<Goldilocks>,
}

impl Public for Written {
    fn axes(&self) -> &[Axis] {
        &self.axes
    }

    fn value(&self, indices: &[usize]) -> Goldilocks {
        let mut place = 0;
        for (&index, &bits) in indices.iter().zip(&self.bits).rev() {
            place = place << bits | index;
        }
        self.values[place]
    }

    fn at(&self, parts: &[&Part]) -> Extension {
        let mut weights = alloc::vec![Extension::ONE];
        for part in parts {
            weights = outer(&weights, &part.weights());
        }
        Extension::dot(&weights, &self.values)
    }
}

/// What [`Public::at`] is, value by value, for a tensor with one axis.
fn weighted_sum(public: &impl Public, parts: &[&Part]) -> Extension {
    let Some(weights) = parts.first().map(|part| part.weights()) else {
        return Extension::ZERO;
    };
    let weights = weights.iter().enumerate();
    weights
        .map(|(index, weight)| weight.scale(public.value(&[index])))
        .sum()
}

/// `start + index` on one axis.
pub struct Affine {
    /// The axis.
    pub axis: [Axis; 1],
    /// The value at index 0.
    pub start: i64,
}

impl Public for Affine {
    fn likes_points(&self) -> bool {
        true
    }

    fn axes(&self) -> &[Axis] {
        &self.axis
    }

    fn value(&self, indices: &[usize]) -> Goldilocks {
        Goldilocks::from_i64(self.start + indices[0] as i64)
    }

    fn at(&self, parts: &[&Part]) -> Extension {
        match parts {
            [Part::Point(point)] => {
                let bits = point.iter().enumerate();
                let index = bits.map(|(bit, x)| x.scale(Goldilocks::from_i64(1 << bit)));
                index.sum::<Extension>() + Goldilocks::from_i64(self.start).into()
            }
            _ => weighted_sum(self, parts),
        }
    }
}

/// Which column of the table of ranges.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RangeColumn {
    /// The value.
    Value,
    /// Its greatest number of bits.
    Bits,
}

/// The table of ranges. Row 2^k + v states that v is below 2^k. Row 0 states the same as row 1.
pub struct Ranges {
    /// The axis of its rows.
    pub axis: [Axis; 1],
    /// Which column this is.
    pub column: RangeColumn,
}

impl Ranges {
    fn of_leading_bit(&self, bit: u32) -> Goldilocks {
        match self.column {
            RangeColumn::Value => Goldilocks::from_i64(1 << bit),
            RangeColumn::Bits => Goldilocks::from_u32(bit),
        }
    }
}

impl Public for Ranges {
    fn likes_points(&self) -> bool {
        true
    }

    fn axes(&self) -> &[Axis] {
        &self.axis
    }

    fn value(&self, indices: &[usize]) -> Goldilocks {
        let row = indices[0].max(1);
        let leading = self.of_leading_bit(row.ilog2());
        match self.column {
            RangeColumn::Value => Goldilocks::from_i64(row as i64) - leading,
            RangeColumn::Bits => leading,
        }
    }

    fn at(&self, parts: &[&Part]) -> Extension {
        let point = match parts {
            [Part::Point(point)] => &point[..],
            _ => return weighted_sum(self, parts),
        };
        // Σ over the leading bit, with the product of 1 − x over all bits above it.
        let (mut above, mut leading) = (Extension::ONE, Extension::ZERO);
        for (bit, &x) in point.iter().enumerate().rev() {
            leading += (above * x).scale(self.of_leading_bit(bit as u32));
            above -= above * x;
        }
        match self.column {
            RangeColumn::Bits => leading,
            RangeColumn::Value => {
                let bits = point.iter().enumerate();
                let row: Extension = bits
                    .map(|(bit, x)| x.scale(Goldilocks::from_i64(1 << bit)))
                    .sum();
                row - leading
            }
        }
    }
}
