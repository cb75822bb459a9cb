//! The int16 matrix product with int64 sums. Mode `direct` spends nearly all of its time here.

use alloc::vec;
use alloc::vec::Vec;

/// Rows of a matrix inside a slice: row `i` is `values[i * stride..][..columns]`.
#[derive(Clone, Copy)]
pub struct Rows<'a, T = i16> {
    values: &'a [T],
    stride: usize,
    columns: usize,
    count: usize,
}

impl<'a, T: Copy> Rows<'a, T> {
    /// Adjacent rows of `columns` values; a last incomplete one is left out.
    pub fn new(values: &'a [T], columns: usize) -> Self {
        Self::strided(values, columns, columns)
    }

    /// Rows of `columns` values whose starts are `stride` ≥ `columns` apart, as many as lie in `values`.
    pub fn strided(values: &'a [T], stride: usize, columns: usize) -> Self {
        let count = match values.len().checked_sub(columns) {
            Some(rest) if stride > 0 => rest / stride + 1,
            _ => 0,
        };
        Self {
            values,
            stride,
            columns,
            count,
        }
    }

    /// The first `count` rows, or all if there are fewer.
    pub fn first(self, count: usize) -> Self {
        Self {
            count: self.count.min(count),
            ..self
        }
    }

    /// Number of rows.
    pub fn count(&self) -> usize {
        self.count
    }

    /// Values of a row.
    pub fn columns(&self) -> usize {
        self.columns
    }

    /// All rows.
    pub fn iter(self) -> impl Iterator<Item = &'a [T]> {
        (0..self.count).map(move |row| &self.values[row * self.stride..][..self.columns])
    }

    /// The columns, one after another.
    pub fn transposed(self) -> Vec<T>
    where
        T: Default,
    {
        let mut transposed = vec![T::default(); self.count * self.columns];
        for (row, values) in self.iter().enumerate() {
            for (&value, column) in values.iter().zip(transposed.chunks_exact_mut(self.count)) {
                column[row] = value;
            }
        }
        transposed
    }

    /// The first `columns` values of `N` rows from `first` on.
    ///
    /// # Safety
    /// `first + N <= self.count` and `columns <= self.columns`.
    #[inline(always)]
    unsafe fn some_unchecked<const N: usize>(&self, first: usize, columns: usize) -> [&'a [T]; N] {
        debug_assert!(first + N <= self.count && columns <= self.columns);
        core::array::from_fn(|index| {
            let start = (first + index) * self.stride;
            // SAFETY: `strided` counts only rows that lie in `values`: row i ends at i·stride + columns ≤ len.
            unsafe { self.values.get_unchecked(start..start + columns) }
        })
    }
}

/// Computes `a · bᵀ`: calls `sink(i * b.count + j, j, sum)` with the product of row `i` of `a` and row `j` of `b`, for all i and
/// j. |a·b| ≤ 2^30, so that 2^16 columns stay far inside int64. If the rows differ in length, the shorter counts.
///
/// Blocks of 2 × 3 rows share their loads. That takes about 3 guest cycles per multiply-add, where a plain loop takes 12. Bounds
/// are checked once per matrix and not per block, because at 12 columns those checks cost as much as a third of the products.
#[inline(always)]
pub fn products(a: Rows<'_>, b: Rows<'_>, mut sink: impl FnMut(usize, usize, i64)) {
    let columns = a.columns.min(b.columns);
    let width = b.count;
    let mut i = 0;
    // SAFETY, for every call of `some_unchecked`: the loop conditions keep i + N ≤ a.count and j + N ≤ b.count.
    while i + 2 <= a.count {
        let left: [&[i16]; 2] = unsafe { a.some_unchecked(i, columns) };
        let at = i * width;
        let mut j = 0;
        while j + 3 <= width {
            let sums = block::<2, 3>(left, unsafe { b.some_unchecked(j, columns) }, columns);
            for (row, sums) in sums.into_iter().enumerate() {
                for (column, sum) in sums.into_iter().enumerate() {
                    sink(at + row * width + j + column, j + column, sum);
                }
            }
            j += 3;
        }
        while j < width {
            let [[first], [second]] =
                block::<2, 1>(left, unsafe { b.some_unchecked(j, columns) }, columns);
            sink(at + j, j, first);
            sink(at + width + j, j, second);
            j += 1;
        }
        i += 2;
    }
    if i < a.count {
        let left: [&[i16]; 1] = unsafe { a.some_unchecked(i, columns) };
        for j in 0..width {
            let [[sum]] = block::<1, 1>(left, unsafe { b.some_unchecked(j, columns) }, columns);
            sink(i * width + j, j, sum);
        }
    }
}

/// Returns Σ a·b over two slices, up to the end of the shorter.
pub fn dot(a: &[i16], b: &[i16]) -> i64 {
    let columns = a.len().min(b.len());
    let [[sum]] = block([&a[..columns]], [&b[..columns]], columns);
    sum
}

/// Products of all rows of `a` and `b`, each of them `columns` long.
#[inline(always)]
fn block<const A: usize, const B: usize>(
    a: [&[i16]; A],
    b: [&[i16]; B],
    columns: usize,
) -> [[i64; B]; A] {
    // Four columns at a time. All slices are cut to one length, so that the loops need no bounds checks.
    let quads = columns / 4;
    let a4 = a.map(|row| &row.as_chunks::<4>().0[..quads]);
    let b4 = b.map(|row| &row.as_chunks::<4>().0[..quads]);
    let mut sums = [[0i64; B]; A];
    for quad in 0..quads {
        for column in 0..4 {
            let right = b4.map(|row| row[quad][column] as i64);
            for (sums, row) in sums.iter_mut().zip(a4) {
                let left = row[quad][column] as i64;
                for (sum, right) in sums.iter_mut().zip(right) {
                    *sum += left * right;
                }
            }
        }
    }
    for column in 4 * quads..columns {
        for (sums, row) in sums.iter_mut().zip(a) {
            for (sum, right) in sums.iter_mut().zip(b) {
                *sum += row[column] as i64 * right[column] as i64;
            }
        }
    }
    sums
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn blocks_give_the_plain_sums(
            rows in 1usize..6, others in 1usize..8, columns in 1usize..20, gap in 0usize..3,
            pool in prop::collection::vec(any::<i16>(), 400),
        ) {
            let stride = columns + gap;
            let (a, b) = (&pool[..rows * stride], &pool[rows..rows + others * columns]);
            let mut sums = vec![0; rows * others];
            let (a_rows, b_rows) = (Rows::strided(a, stride, columns), Rows::new(b, columns));
            prop_assert_eq!((a_rows.count(), b_rows.count()), (rows, others));
            products(a_rows, b_rows, |index, column, sum| {
                assert_eq!(index % others, column);
                sums[index] = sum;
            });
            for i in 0..rows {
                for j in 0..others {
                    let plain: i64 = (0..columns)
                        .map(|c| a[i * stride + c] as i64 * b[j * columns + c] as i64)
                        .sum();
                    prop_assert_eq!(sums[i * others + j], plain);
                }
            }
        }
    }
}
