//! Sums of rows of int16 weights, each row times four numbers. Compilers turn this into vector instructions.

use alloc::vec;
use alloc::vec::Vec;

/// For each of the four factors of a row and for each column, `Σ factor · values[row·columns + column]`. A sum has to fit an int64: with |factor| ≤
/// 2^31 it does for 2^16 rows.
///
/// It takes four rows at a time, so that sums are loaded and stored once for four rows.
pub fn combine(values: &[i16], columns: usize, factors: &[[i32; 4]]) -> [Vec<i64>; 4] {
    let mut sums = [(); 4].map(|()| vec![0i64; columns]);
    let blocks = values.chunks_exact(4 * columns);
    let (fours, rest) = factors.as_chunks::<4>();
    let later = &values[(4 * columns * fours.len()).min(values.len())..];
    for (rows, by) in blocks.zip(fours) {
        let (a, rows) = rows.split_at(columns);
        let (b, rows) = rows.split_at(columns);
        let (c, d) = rows.split_at(columns);
        for (part, sums) in sums.iter_mut().enumerate() {
            let by = by.map(|factors| factors[part] as i64);
            let rows = a.iter().zip(b).zip(c).zip(d);
            for (sum, (((&a, &b), &c), &d)) in sums.iter_mut().zip(rows) {
                let (a, b, c, d) = (a as i64, b as i64, c as i64, d as i64);
                *sum += a * by[0] + b * by[1] + c * by[2] + d * by[3];
            }
        }
    }
    for (row, by) in later.chunks_exact(columns).zip(rest) {
        for (sums, &factor) in sums.iter_mut().zip(by) {
            for (sum, &value) in sums.iter_mut().zip(row) {
                *sum += value as i64 * factor as i64;
            }
        }
    }
    sums
}
