//! From exact numbers to a file, a tensor at a time: the blocks of a tensor are combined on all cores, then its scale is known, and
//! then its numbers are rounded, once.
//!
//! The numbers wait for the scale as integers of 32, 64 or 128 bits: the fewest in which no sum can overflow, which the scales and the
//! weights of the contributions tell beforehand.

use crate::combine::contributions::CombineError;
use crate::combine::source::{Block, Rows, BLOCK};
use rayon::prelude::*;
use zk0_circuits::model::layout::MAX_WEIGHT_BITS;
use zk0_weights::rounding::{Rounded, Unit};
use zk0_weights::{Format, Unread};

/// Values that wait for their scale at once. As 128-bit integers they take 64 MiB. The largest tensor of the published size has less.
const WAITING: usize = 4 << 20;

/// The exact numbers of one tensor, before they are computed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Plan {
    /// What the integers stand for.
    pub unit: Unit,
    /// No integer is larger in magnitude, neither on the way nor at the end.
    pub bound: u128,
}

/// How contributions become exact numbers.
pub trait Combination: Sync {
    /// What the numbers of this tensor will be.
    fn plan(&self, tensor: usize) -> Plan;

    /// Computes the numbers of a block, which are zeros before.
    ///
    /// # Errors
    /// A contribution cannot be read.
    fn combine<T: Integer>(
        &self,
        block: &Block,
        numbers: &mut [T],
        rows: &mut Rows,
    ) -> Result<(), CombineError>;
}

/// Integers of one of three sizes.
pub trait Integer: Rounded + Default + Send + Sync {
    /// The integer, which fits.
    fn of(number: i128) -> Self;

    /// The integer.
    fn wide(self) -> i128;

    /// Adds the products of `factor` and `values`.
    fn add_products(numbers: &mut [Self], factor: i128, values: &[i16]);

    /// The largest magnitude.
    fn largest(numbers: &[Self]) -> u128;
}

macro_rules! integer {
    ($type:ty) => {
        impl Integer for $type {
            fn of(number: i128) -> Self {
                number as $type
            }

            fn wide(self) -> i128 {
                self as i128
            }

            fn add_products(numbers: &mut [Self], factor: i128, values: &[i16]) {
                let factor = factor as $type;
                for (number, value) in numbers.iter_mut().zip(values) {
                    *number += factor * <$type>::from(*value);
                }
            }

            fn largest(numbers: &[Self]) -> u128 {
                let largest = numbers.iter().map(|one| one.unsigned_abs()).max();
                largest.unwrap_or(0) as u128
            }
        }
    };
}
integer!(i32);
integer!(i64);
integer!(i128);

/// Makes the file of what `combination` gives. `unread` is what the base holds where the evaluation does not read.
pub fn file(
    format: &Format,
    combination: &impl Combination,
    unread: &Unread,
) -> Result<Vec<u8>, CombineError> {
    format.build(|mut places| {
        let mut scales = Vec::with_capacity(places.len());
        let (mut rest, mut first) = (&mut places[..], 0);
        while !rest.is_empty() {
            let (group, later) = rest.split_at_mut(group(rest));
            let tensors = group.par_iter_mut().enumerate().map(|(index, place)| {
                let tensor = Tensor {
                    index: first + index,
                    limits: format.limits()[first + index],
                };
                tensor.write(combination, unread, place)
            });
            scales.extend(tensors.collect::<Result<Vec<_>, _>>()?);
            first += group.len();
            rest = later;
        }
        Ok(scales)
    })
}

/// How many of the first tensors have at most [`WAITING`] values together; at least one.
fn group(places: &[&mut [u8]]) -> usize {
    let mut values = 0;
    let fits = |place: &&&mut [u8]| {
        values += place.len() / 2;
        values <= WAITING
    };
    places.iter().take_while(fits).count().max(1)
}

/// A tensor of the result.
struct Tensor {
    index: usize,
    limits: (i16, i16),
}

impl Tensor {
    /// Writes the values, and gives their fraction bits.
    fn write(
        &self,
        combination: &impl Combination,
        unread: &Unread,
        out: &mut [u8],
    ) -> Result<i16, CombineError> {
        let Plan { unit, bound } = combination.plan(self.index);
        if unread.concerns(self.index) {
            let (mut numbers, _) = self.numbers::<i128>(combination, out.len() / 2)?;
            let finest = Unit {
                bits: MAX_WEIGHT_BITS,
                ..unit
            };
            for number in &mut numbers {
                *number <<= (finest.bits - unit.bits).max(0);
            }
            unread.restore(self.index, &mut numbers, finest.divisor);
            let largest = Integer::largest(&numbers);
            return Ok(self.round(finest, &numbers, largest, out));
        }
        if bound < 1 << 31 {
            self.combined::<i32>(combination, unit, out)
        } else if bound < 1 << 63 {
            self.combined::<i64>(combination, unit, out)
        } else {
            self.combined::<i128>(combination, unit, out)
        }
    }

    fn combined<T: Integer>(
        &self,
        combination: &impl Combination,
        unit: Unit,
        out: &mut [u8],
    ) -> Result<i16, CombineError> {
        let (numbers, largest) = self.numbers::<T>(combination, out.len() / 2)?;
        Ok(self.round(unit, &numbers, largest, out))
    }

    /// The exact numbers, and their largest magnitude.
    fn numbers<T: Integer>(
        &self,
        combination: &impl Combination,
        len: usize,
    ) -> Result<(Vec<T>, u128), CombineError> {
        let mut numbers = vec![T::default(); len];
        let blocks: Vec<_> = Block::of(self.index, len).collect();
        let largest = (numbers.par_chunks_mut(BLOCK).zip(&blocks))
            .map_init(Rows::default, |rows, (numbers, block)| {
                combination.combine(block, numbers, rows)?;
                Ok::<_, CombineError>(T::largest(numbers))
            })
            .try_reduce(|| 0, |one, other| Ok(one.max(other)))?;
        Ok((numbers, largest))
    }

    fn round<T: Integer>(&self, unit: Unit, numbers: &[T], largest: u128, out: &mut [u8]) -> i16 {
        let bits = unit.scale(largest, self.limits);
        let rounding = unit.to(bits);
        (numbers.par_chunks(BLOCK).zip(out.par_chunks_mut(2 * BLOCK)))
            .for_each(|(numbers, out)| rounding.write(numbers, largest, out));
        bits
    }
}
