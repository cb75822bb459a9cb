//! Matrix products over strided views of plain memory, by the `gemm` crate.

use gemm::Parallelism;

/// A strided matrix inside a slice: element (i, j) is `values[i * row_stride + j * column_stride]`.
#[derive(Clone, Copy)]
pub struct Matrix<'a> {
    values: &'a [f32],
    rows: usize,
    columns: usize,
    row_stride: usize,
    column_stride: usize,
}

impl<'a> Matrix<'a> {
    /// `rows x columns` values in order. More may follow.
    ///
    /// # Panics
    /// There are fewer values.
    pub fn new(values: &'a [f32], rows: usize, columns: usize) -> Self {
        Self::strided(values, rows, columns, columns)
    }

    /// Rows of `columns` values, whose starts are `row_stride` apart.
    ///
    /// # Panics
    /// The last row does not lie in `values`.
    pub fn strided(values: &'a [f32], rows: usize, columns: usize, row_stride: usize) -> Self {
        assert!(extent(rows, columns, row_stride) <= values.len());
        Self {
            values,
            rows,
            columns,
            row_stride,
            column_stride: 1,
        }
    }

    /// Rows as columns.
    pub fn transposed(self) -> Self {
        Self {
            rows: self.columns,
            columns: self.rows,
            row_stride: self.column_stride,
            column_stride: self.row_stride,
            ..self
        }
    }
}

/// Values from the first to the last of `rows` rows of `columns` values whose starts are `stride` apart.
fn extent(rows: usize, columns: usize, stride: usize) -> usize {
    match (rows, columns) {
        (0, _) | (_, 0) => 0,
        _ => (rows - 1) * stride + columns,
    }
}

/// Where a product goes.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Into {
    /// What was there is replaced.
    Replace,
    /// The product is added to what was there.
    Add,
}

/// How many threads a product may take.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Threads {
    /// This one.
    One,
    /// All of rayon's.
    All,
}

/// `out = scale · a·b` or `out += scale · a·b`, rows of `out` being `out_stride` apart.
///
/// # Panics
/// The shapes disagree, or `out` is too short.
pub fn product(
    a: Matrix,
    b: Matrix,
    scale: f32,
    out: &mut [f32],
    out_stride: usize,
    into: Into,
    threads: Threads,
) {
    assert_eq!(a.columns, b.rows, "inner dimensions of a product");
    assert!(b.columns <= out_stride && extent(a.rows, b.columns, out_stride) <= out.len());
    let (rows, columns, inner) = (a.rows, b.columns, a.columns);
    let parallelism = match threads {
        Threads::One => Parallelism::None,
        Threads::All => Parallelism::Rayon(rayon::current_num_threads()),
    };
    // SAFETY: every element that the shapes and strides name lies in its slice: `Matrix` is made with that check, transposing
    // keeps it, and the output's was made just now. `out` is borrowed mutably, so it overlaps neither operand; its rows do not
    // overlap, as they are at least as far apart as they are long.
    unsafe {
        gemm::gemm(
            rows,
            columns,
            inner,
            out.as_mut_ptr(),
            1,
            out_stride as isize,
            into == Into::Add,
            a.values.as_ptr(),
            a.column_stride as isize,
            a.row_stride as isize,
            b.values.as_ptr(),
            b.column_stride as isize,
            b.row_stride as isize,
            1.0,
            scale,
            false,
            false,
            false,
            parallelism,
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn strided_and_transposed_products_are_the_plain_ones() {
        let a: Vec<f32> = (0..35).map(|x| x as f32 - 11.0).collect();
        let b: Vec<f32> = (0..30).map(|x| (x * x % 13) as f32).collect();
        // 4 x 3 inside rows of 7, times the transpose of 5 x 3 inside rows of 5.
        let (left, right) = (
            Matrix::strided(&a[2..], 4, 3, 7),
            Matrix::strided(&b, 5, 3, 5),
        );
        let mut out = vec![1.0f32; 4 * 6];
        product(
            left,
            right.transposed(),
            2.0,
            &mut out,
            6,
            Into::Add,
            Threads::All,
        );
        for i in 0..4 {
            for j in 0..5 {
                let dot: f32 = (0..3).map(|k| a[2 + i * 7 + k] * b[j * 5 + k]).sum();
                assert_eq!(out[i * 6 + j], 1.0 + 2.0 * dot);
            }
            assert_eq!(out[i * 6 + 5], 1.0, "between the rows nothing is written");
        }
        product(
            left,
            right.transposed(),
            1.0,
            &mut out,
            6,
            Into::Replace,
            Threads::One,
        );
        assert_eq!(out[0], (0..3).map(|k| a[2 + k] * b[k]).sum::<f32>());
    }
}
