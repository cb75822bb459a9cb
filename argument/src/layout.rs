//! Where pieces of several sizes lie one after the other: look-ups among the leaves of a sum, and tensors in a source. Sizes are powers of two,
//! and larger pieces come first, so that each begins at a multiple of its size.

use crate::field::Extension;
use crate::multilinear::EqBits;
use crate::relation::{Lookup, Relations};
use alloc::vec;
use alloc::vec::Vec;

/// Numbers of sizes, from the largest size to the smallest. They are counted rather than sorted: there are few sizes.
pub fn from_largest(sizes: &[u8]) -> Vec<usize> {
    let mut places = [0; 1 << u8::BITS];
    for &size in sizes {
        places[size as usize] += 1;
    }
    // The place of the next number with each size
    let mut end = 0;
    for place in places.iter_mut().rev() {
        let count = *place;
        *place = end;
        end += count;
    }
    let mut order = vec![0; sizes.len()];
    for (number, &size) in sizes.iter().enumerate() {
        let place = &mut places[size as usize];
        order[*place] = number;
        *place += 1;
    }
    order
}

/// Where the look-ups of one instance lie among the leaves of a sum of fractions.
pub struct LookupLayout {
    /// The first leaf of each look-up: a multiple of its size.
    pub offsets: Vec<usize>,
    /// Binary logarithm of the size of each look-up.
    sizes: Vec<u8>,
    /// Numbers of look-ups in the order in which they lie.
    order: Vec<usize>,
    /// Binary logarithm of the number of leaves.
    pub variables: usize,
}

impl LookupLayout {
    /// Larger look-ups come first, so that each offset is a multiple of the size.
    pub fn new(relations: &Relations) -> Self {
        let size = |lookup: &Lookup| relations.size_of_one(&lookup.axes) as u8;
        let sizes: Vec<u8> = relations.lookups.iter().map(size).collect();
        let order = from_largest(&sizes);
        let mut offsets = vec![0; order.len()];
        let mut end = 0usize;
        for &number in &order {
            offsets[number] = end;
            end += 1 << sizes[number];
        }
        Self {
            offsets,
            sizes,
            order,
            variables: end.next_power_of_two().trailing_zeros().max(1) as usize,
        }
    }
}

impl LookupLayout {
    /// For each look-up the multilinear polynomial that is 1 on its leaves and 0 on others, at `point`.
    pub fn places(&self, point: &[Extension]) -> Vec<Extension> {
        let mut places = vec![Extension::ZERO; self.order.len()];
        let mut bits = EqBits::new(point);
        for &number in &self.order {
            places[number] = bits.above(self.offsets[number], self.sizes[number] as usize);
        }
        places
    }
}
