//! From exact numbers to a file, one tensor at a time: all cores combine its blocks, which gives its scale, and then its numbers
//! are rounded, once.
//!
//! Until then the numbers are integers of 32, 64 or 128 bits: the fewest in which no sum can overflow, by the contributions'
//! scales and weights.

use crate::combine::error::CombineError;
use crate::combine::optimizers::moments::{Moment, Moments};
use crate::combine::source::{Block, BlockBuffer, BLOCK};
use bytemuck::Pod;
use rayon::prelude::*;
use zk0_circuits::model::layout::MAX_WEIGHT_BITS;
use zk0_weights::rounding::{Rounded, Unit};
use zk0_weights::{BuiltFile, Format, Unread};

/// Values that wait for their scale at once: at most 32 MiB. The largest tensor of the published size has fewer.
const WAITING: usize = 2 << 20;

/// The exact numbers of one tensor, before they are computed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Plan {
    /// The integers' unit.
    pub unit: Unit,
    /// The largest magnitude, at every step.
    pub bound: u128,
}

/// How contributions become exact numbers.
pub trait Combination: Sync {
    /// The plan for this tensor.
    fn plan(&self, tensor: usize) -> Plan;

    /// Computes the numbers of a block, which start as zeros. `moments` are those before the round, and on return those after
    /// it; empty if the strategy has none.
    ///
    /// # Errors
    /// A contribution cannot be read.
    fn combine<T: Integer>(
        &self,
        block: &Block,
        numbers: &mut [T],
        moments: &mut [Moment],
        rows: &mut BlockBuffer,
    ) -> Result<(), CombineError>;
}

/// Integers of 32, 64 or 128 bits.
pub trait Integer: Rounded + Pod + Send + Sync + Default {
    /// The integer, which fits.
    fn of(number: i128) -> Self;

    /// The nearest float64, ties to even.
    fn nearest(self) -> f64;

    /// Adds each factor times its row. Rows have the length of `numbers`.
    fn add_products(numbers: &mut [Self], factors: &[i128], rows: &[&[i16]]);

    /// The largest magnitude.
    fn largest(numbers: &[Self]) -> u128;
}

macro_rules! integer {
    ($type:ty) => {
        impl Integer for $type {
            fn of(number: i128) -> Self {
                number as $type
            }

            fn nearest(self) -> f64 {
                self as f64
            }

            fn add_products(numbers: &mut [Self], factors: &[i128], rows: &[&[i16]]) {
                // Four rows at once touch the numbers a quarter as often.
                if let ([f, g, h, i], [a, b, c, d]) = (factors, rows) {
                    let [f, g, h, i] = [f, g, h, i].map(|factor| *factor as $type);
                    let rows = a.iter().zip(*b).zip(*c).zip(*d);
                    for (number, (((a, b), c), d)) in numbers.iter_mut().zip(rows) {
                        let [a, b, c, d] = [a, b, c, d].map(|value| <$type>::from(*value));
                        *number += (f * a + g * b) + (h * c + i * d);
                    }
                    return;
                }
                for (factor, row) in factors.iter().zip(rows) {
                    let factor = *factor as $type;
                    for (number, value) in numbers.iter_mut().zip(*row) {
                        *number += factor * <$type>::from(*value);
                    }
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

/// Makes the file of `combination`'s numbers. `unread` is the base's unread part. `moments` are for a strategy that has some.
pub fn file(
    format: &Format,
    combination: &impl Combination,
    unread: &Unread,
    mut moments: Option<&mut Moments<'_>>,
) -> Result<BuiltFile, CombineError> {
    format.build(|mut places| {
        let longest = format.tensors().iter().map(|tensor| tensor.len()).max();
        // Every group reuses the memory: fresh memory costs time.
        let mut memory = vec![0i128; longest.unwrap_or(0).max(WAITING)];
        let mut kept = Vec::new();
        let mut scales = Vec::with_capacity(places.len());
        let mut rest = &mut places[..];
        while !rest.is_empty() {
            let count = group(rest);
            let (places, later) = rest.split_at_mut(count);
            let mut free = &mut memory[..];
            if let Some(moments) = &mut moments {
                let values = places.iter().map(|place| place.len() / 2).sum();
                kept.resize(values, Moment::default());
                moments.read(&mut kept)?;
            }
            let mut unassigned = &mut kept[..];
            let mut tensors = Vec::with_capacity(count);
            for (index, out) in (scales.len()..).zip(places) {
                let (memory, others) = free.split_at_mut(out.len() / 2);
                let own = unassigned.len().min(out.len() / 2);
                let (moments, later) = unassigned.split_at_mut(own);
                tensors.push(ResultTensor {
                    index,
                    limits: format.limits()[index],
                    memory,
                    moments,
                    out,
                });
                (free, unassigned) = (others, later);
            }
            let written = tensors.into_par_iter();
            let written = written.map(|tensor| tensor.write(combination, unread));
            scales.extend(written.collect::<Result<Vec<_>, _>>()?);
            if let Some(moments) = &mut moments {
                moments.write(&kept)?;
            }
            rest = later;
        }
        Ok(scales)
    })
}

/// How many first tensors have together at most [`WAITING`] values; at least one.
fn group(places: &[&mut [u8]]) -> usize {
    let mut values = 0;
    let fits = |place: &&&mut [u8]| {
        values += place.len() / 2;
        values <= WAITING
    };
    places.iter().take_while(fits).count().max(1)
}

struct ResultTensor<'a> {
    index: usize,
    limits: (i16, i16),
    /// For its exact numbers.
    memory: &'a mut [i128],
    /// Of its values, if the strategy has some.
    moments: &'a mut [Moment],
    /// For its values.
    out: &'a mut [u8],
}

impl ResultTensor<'_> {
    /// Writes the values and returns their fraction bits.
    fn write(self, combination: &impl Combination, unread: &Unread) -> Result<i16, CombineError> {
        let Plan { unit, bound } = combination.plan(self.index);
        if unread.concerns(self.index) {
            self.with_unread(combination, unit, unread)
        } else if bound < 1 << 31 {
            self.combined::<i32>(combination, unit)
        } else if bound < 1 << 63 {
            self.combined::<i64>(combination, unit)
        } else {
            self.combined::<i128>(combination, unit)
        }
    }

    fn combined<T: Integer>(
        self,
        combination: &impl Combination,
        unit: Unit,
    ) -> Result<i16, CombineError> {
        let numbers = bytemuck::cast_slice_mut::<i128, T>(self.memory);
        let numbers = &mut numbers[..self.out.len() / 2];
        let largest = combine(self.index, combination, numbers, self.moments)?;
        Ok(round(unit, self.limits, numbers, largest, self.out))
    }

    fn with_unread(
        self,
        combination: &impl Combination,
        unit: Unit,
        unread: &Unread,
    ) -> Result<i16, CombineError> {
        let numbers = self.memory;
        combine(self.index, combination, numbers, self.moments)?;
        let finest = Unit {
            bits: MAX_WEIGHT_BITS,
            ..unit
        };
        for number in &mut *numbers {
            *number <<= (finest.bits - unit.bits).max(0);
        }
        unread.restore(self.index, numbers, finest.divisor);
        let largest = Integer::largest(numbers);
        Ok(round(finest, self.limits, numbers, largest, self.out))
    }
}

/// Computes a tensor's exact numbers and returns their largest magnitude.
fn combine<T: Integer>(
    tensor: usize,
    combination: &impl Combination,
    numbers: &mut [T],
    mut moments: &mut [Moment],
) -> Result<u128, CombineError> {
    let blocks = Block::of(tensor, numbers.len()).map(|block| {
        let own = block.len.min(moments.len());
        let (own, later) = std::mem::take(&mut moments).split_at_mut(own);
        moments = later;
        (block, own)
    });
    let blocks: Vec<_> = blocks.collect();
    let largest = (numbers.par_chunks_mut(BLOCK).zip(blocks)).map_init(
        BlockBuffer::default,
        |rows, (numbers, (block, moments))| {
            numbers.fill(T::default());
            combination.combine(&block, numbers, moments, rows)?;
            Ok(T::largest(numbers))
        },
    );
    largest.try_reduce(|| 0, |one, other| Ok(one.max(other)))
}

/// Rounds a tensor's numbers and returns their fraction bits.
fn round<T: Integer>(
    unit: Unit,
    limits: (i16, i16),
    numbers: &[T],
    largest: u128,
    out: &mut [u8],
) -> i16 {
    let bits = unit.scale(largest, limits);
    let rounding = unit.to(bits);
    (numbers.par_chunks(BLOCK).zip(out.par_chunks_mut(2 * BLOCK)))
        .for_each(|(numbers, out)| rounding.write(numbers, largest, out));
    bits
}
