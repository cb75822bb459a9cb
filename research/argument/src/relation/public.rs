//! Tensors that both sides compute, and that the verifier evaluates at a point.

use super::Axis;
use crate::field::{Extension, Goldilocks};
use crate::multilinear::eq_table;
use alloc::vec::Vec;

/// A tensor that both sides compute.
pub trait Public: Sync {
    /// Its axes, from the lowest.
    fn axes(&self) -> &[Axis];
    /// Its value at these indices, one on each axis.
    fn value(&self, indices: &[usize]) -> Goldilocks;
    /// The multilinear polynomial with these values, at a point with the coordinates of one axis after those of the other.
    fn at(&self, point: &[Extension]) -> Extension;
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

    fn at(&self, point: &[Extension]) -> Extension {
        Extension::dot(&eq_table(point), &self.values)
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

/// The table of ranges. Row 2^k + v says that v is below 2^k. Row 0 says the same as row 1.
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

    fn at(&self, point: &[Extension]) -> Extension {
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
