//! Matrix products over strided views of plain memory.
//!
//! Each of two libraries is up to three times as fast as the other where chosen (see `step_floors`): `gemm`, as in candle, packs its
//! operands and suits many rows; `faer` suits few rows and long sums.

use faer::linalg::matmul::matmul;
use faer::{Accum, MatMut, MatRef, Par};
use gemm::Parallelism;

/// A strided matrix in a slice, with element (i, j) at `i * row_stride + j * column_stride`.
#[derive(Clone, Copy)]
pub struct StridedMatrix<'a> {
    values: &'a [f32],
    rows: usize,
    columns: usize,
    row_stride: usize,
    column_stride: usize,
}

impl<'a> StridedMatrix<'a> {
    /// The first `rows x columns` values, in order.
    ///
    /// # Panics
    /// There are fewer values.
    pub fn new(values: &'a [f32], rows: usize, columns: usize) -> Self {
        Self::strided(values, rows, columns, columns)
    }

    /// Rows of `columns` values that start `row_stride` apart.
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

    fn view(&self) -> MatRef<'a, f32> {
        let (rows, columns) = (self.row_stride as isize, self.column_stride as isize);
        // SAFETY: `StridedMatrix` is made with a check that every element lies in `values`; transposing keeps that.
        unsafe {
            MatRef::from_raw_parts(self.values.as_ptr(), self.rows, self.columns, rows, columns)
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

fn extent(rows: usize, columns: usize, stride: usize) -> usize {
    match (rows, columns) {
        (0, _) | (_, 0) => 0,
        _ => (rows - 1) * stride + columns,
    }
}

/// Where a product goes.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Into {
    /// In place of the old values.
    Replace,
    /// Added to the old values.
    Add,
}

/// How many threads a product may take.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Threads {
    /// The caller's.
    One,
    /// All of rayon's, if the product is large enough.
    All,
}

/// Multiplications up to which one thread is faster.
const SMALL: usize = 1 << 22;

/// From here on, packing the operands pays.
const MANY_ROWS: usize = 256;

/// For sums this many times longer than rows, `gemm` stalls in packing the right operand.
const LONG_SUMS: usize = 2;

/// `a·b`, row after row, with all of rayon's threads.
///
/// # Panics
/// The shapes disagree.
pub fn product_of(a: StridedMatrix, b: StridedMatrix) -> Vec<f32> {
    assert_eq!(a.columns, b.rows, "inner dimensions of a product");
    let (rows, columns) = (a.rows, b.columns);
    if a.columns == 0 {
        return vec![0.0; rows * columns];
    }
    let mut out = Vec::with_capacity(rows * columns);
    // SAFETY: just reserved. A replacing product writes all and reads nothing.
    unsafe {
        multiply(
            a,
            b,
            1.0,
            out.as_mut_ptr(),
            columns,
            Into::Replace,
            Threads::All,
        );
        out.set_len(rows * columns);
    }
    out
}

/// `out = scale · a·b` or `out += scale · a·b`, with rows `out_stride` apart.
///
/// # Panics
/// The shapes disagree, or `out` is too short.
pub fn product(
    a: StridedMatrix,
    b: StridedMatrix,
    scale: f32,
    out: &mut [f32],
    out_stride: usize,
    into: Into,
    threads: Threads,
) {
    assert_eq!(a.columns, b.rows, "inner dimensions of a product");
    assert!(b.columns <= out_stride && extent(a.rows, b.columns, out_stride) <= out.len());
    // SAFETY: the checks above show that the named elements lie in `out`. Its mutable borrow overlaps neither operand; its rows are at
    // least as far apart as they are long, so they do not overlap.
    unsafe { multiply(a, b, scale, out.as_mut_ptr(), out_stride, into, threads) }
}

/// # Safety
/// At `out`, `a.rows` rows of `b.columns` values, `out_stride` apart and at least as far as they are long, may be written, and read if the
/// product is added. They overlap neither operand.
unsafe fn multiply(
    a: StridedMatrix,
    b: StridedMatrix,
    scale: f32,
    out: *mut f32,
    out_stride: usize,
    into: Into,
    threads: Threads,
) {
    let (rows, columns, inner) = (a.rows, b.columns, a.columns);
    let parallel = threads == Threads::All && rows * columns * inner > SMALL;
    // SAFETY: `StridedMatrix` checks when made that all elements named by shape and strides lie in its slice; transposing keeps that. The
    // caller vouches for the output.
    unsafe {
        if rows < MANY_ROWS || inner > LONG_SUMS * columns {
            let stride = out_stride as isize;
            let out = MatMut::from_raw_parts_mut(out, rows, columns, stride, 1);
            let into = match into {
                Into::Replace => Accum::Replace,
                Into::Add => Accum::Add,
            };
            let threads = if parallel { Par::rayon(0) } else { Par::Seq };
            matmul(out, into, a.view(), b.view(), scale, threads);
        } else {
            gemm::gemm(
                rows,
                columns,
                inner,
                out,
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
                if parallel {
                    Parallelism::Rayon(rayon::current_num_threads())
                } else {
                    Parallelism::None
                },
            );
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn strided_and_transposed_products_are_the_plain_ones() {
        let a: Vec<f32> = (0..35).map(|x| x as f32 - 11.0).collect();
        let b: Vec<f32> = (0..30).map(|x| (x * x % 13) as f32).collect();
        let (left, right) = (
            StridedMatrix::strided(&a[2..], 4, 3, 7),
            StridedMatrix::strided(&b, 5, 3, 5),
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

    #[test]
    fn results_do_not_depend_on_the_number_of_threads() {
        for (rows, inner, columns) in [(50, 720, 512), (512, 128, 256), (300, 2048, 64)] {
            let values = |count: usize, step: f32| -> Vec<f32> {
                (0..count).map(|i| (i as f32 * step).sin()).collect()
            };
            let (a, b) = (values(rows * inner, 0.3), values(columns * inner, 0.7));
            assert!(rows * inner * columns > SMALL);
            let with = |threads: usize| {
                let pool = rayon::ThreadPoolBuilder::new().num_threads(threads);
                pool.build().unwrap().install(|| {
                    let b = StridedMatrix::new(&b, columns, inner).transposed();
                    product_of(StridedMatrix::new(&a, rows, inner), b)
                })
            };
            let one = with(1);
            assert_eq!(one, with(2));
            assert_eq!(one, with(5));
            let exact: f64 = (0..inner).map(|k| f64::from(a[k]) * f64::from(b[k])).sum();
            assert!((f64::from(one[0]) - exact).abs() < 1e-4 * inner as f64);
        }
    }
}
