//! Numbers that differ along an axis, as scales do from layer to layer.

use super::axis::Axis;
use alloc::vec::Vec;

/// A number that may differ along an axis.
#[derive(Clone, Debug)]
pub enum Along {
    /// The same everywhere.
    Everywhere(i64),
    /// One for each index.
    Axis(Axis, Vec<i64>),
}

impl Along {
    /// The numbers `f` makes of these.
    pub fn map(&self, f: impl Fn(i64) -> i64) -> Self {
        match self {
            Self::Everywhere(number) => Self::Everywhere(f(*number)),
            Self::Axis(axis, numbers) => {
                Self::Axis(*axis, numbers.iter().map(|&number| f(number)).collect())
            }
        }
    }

    /// The largest number.
    pub fn most(&self) -> i64 {
        match self {
            Self::Everywhere(number) => *number,
            Self::Axis(_, numbers) => numbers.iter().copied().max().unwrap_or_default(),
        }
    }
}
