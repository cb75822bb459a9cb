//! The int16 matrix product with int64 sums: where nearly all of the evaluation's work is.

/// Rows of an int16 matrix inside a slice: row `i` is `values[i * stride..][..columns]`.
#[derive(Clone, Copy)]
pub struct Rows<'a> {
    values: &'a [i16],
    stride: usize,
    columns: usize,
    count: usize,
}

impl<'a> Rows<'a> {
    /// Adjacent rows of `columns` values; a last incomplete one is left out.
    pub fn new(values: &'a [i16], columns: usize) -> Self {
        Self::strided(values, columns, columns)
    }

    /// Rows of `columns` values whose starts are `stride` ≥ `columns` apart.
    pub fn strided(values: &'a [i16], stride: usize, columns: usize) -> Self {
        let count = (values.len() + stride).saturating_sub(columns) / stride.max(1);
        Self {
            values,
            stride,
            columns,
            count,
        }
    }

    /// Number of rows.
    pub fn count(&self) -> usize {
        self.count
    }

    #[inline(always)]
    fn row(&self, index: usize) -> &'a [i16] {
        &self.values[index * self.stride..][..self.columns]
    }

    #[inline(always)]
    fn some<const N: usize>(&self, first: usize) -> [&'a [i16]; N] {
        core::array::from_fn(|index| self.row(first + index))
    }
}

/// `a · bᵀ`: sets `sums[i * b.count + j]` to the product of row `i` of `a` with row `j` of `b`, which have equally many
/// columns. |a·b| ≤ 2^30, so 2^16 columns stay far inside int64.
///
/// Blocks of 2 × 3 rows share their loads: about 3 guest cycles per multiply-add, where a plain loop takes 12.
pub fn products(a: Rows<'_>, b: Rows<'_>, sums: &mut [i64]) {
    let (mut i, width) = (0, b.count);
    while i + 2 <= a.count {
        let mut j = 0;
        while j + 3 <= width {
            let [first, second] = block::<2, 3>(a.some(i), b.some(j));
            sums[i * width + j..][..3].copy_from_slice(&first);
            sums[(i + 1) * width + j..][..3].copy_from_slice(&second);
            j += 3;
        }
        while j < width {
            let [[first], [second]] = block::<2, 1>(a.some(i), b.some(j));
            sums[i * width + j] = first;
            sums[(i + 1) * width + j] = second;
            j += 1;
        }
        i += 2;
    }
    while i < a.count {
        for j in 0..width {
            sums[i * width + j] = dot(a.row(i), b.row(j));
        }
        i += 1;
    }
}

/// Σ a·b over equally long slices.
pub fn dot(a: &[i16], b: &[i16]) -> i64 {
    let [[sum]] = block([a], [b]);
    sum
}

#[inline(always)]
fn block<const A: usize, const B: usize>(a: [&[i16]; A], b: [&[i16]; B]) -> [[i64; B]; A] {
    // Four columns at a time. All slices are cut to one length, so that the loops need no bounds checks.
    let quads = a[0].len() / 4;
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
    for column in 4 * quads..a[0].len() {
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
            products(a_rows, b_rows, &mut sums);
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
