//! Matrix products over strided views of plain memory.
//!
//! Two libraries compute them, as each is up to three times as fast as the other where it is chosen (`step_floors` shows it):
//! `gemm`, which candle uses too, packs its operands and is the faster one for many rows; `faer` is for few, and for long sums.

use faer::linalg::matmul::matmul;
use faer::{Accum, MatMut, MatRef, Par};
use gemm::Parallelism;

/// A strided matrix inside a slice: element (i, j) is `values[i * row_stride + j * column_stride]`.
#[derive(Clone, Copy)]
pub struct StridedMatrix<'a> {
    values: &'a [f32],
    rows: usize,
    columns: usize,
    row_stride: usize,
    column_stride: usize,
}

impl<'a> StridedMatrix<'a> {
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

    fn view(&self) -> MatRef<'a, f32> {
        let (rows, columns) = (self.row_stride as isize, self.column_stride as isize);
        // SAFETY: `StridedMatrix` is made with the check that every element lies in `values`, and transposing keeps it.
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
    /// All of rayon's, where the product is large enough to be worth waking them.
    All,
}

/// Multiplications of the largest product that one thread finishes before another would have begun.
const SMALL: usize = 1 << 22;

/// From so many rows of the result on, packing the operands pays.
const MANY_ROWS: usize = 256;

/// With sums so many times longer than the result's rows, `gemm`'s packing of the right operand stalls.
const LONG_SUMS: usize = 2;

/// `a·b`, row after row, from all of rayon's threads.
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
    // SAFETY: as much was just reserved. A product that replaces reads nothing of what was there, and writes all of it.
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

/// `out = scale · a·b` or `out += scale · a·b`, rows of `out` being `out_stride` apart.
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
    // SAFETY: the elements that shapes and stride name lie in `out`, as was just made sure. It is borrowed mutably, so it overlaps
    // neither operand; its rows do not overlap, as they are at least as far apart as they are long.
    unsafe { multiply(a, b, scale, out.as_mut_ptr(), out_stride, into, threads) }
}

/// # Safety
/// `a.rows` rows of `b.columns` values, `out_stride` apart and at least as far as they are long, may be written at `out`, and
/// read where the product is added; they overlap neither operand.
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
    // SAFETY: every element that the operands' shapes and strides name lies in their slices: `StridedMatrix` is made with that check, and
    // transposing keeps it. The output's is the caller's word.
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
        // A matrix of 4 x 3 in rows of 7 is multiplied by the transpose of one of 5 x 3 in rows of 5.
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
        // Few rows, many rows and long sums: each is large enough for several threads.
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
