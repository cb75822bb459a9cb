//! Values to prove, from a fixed seed: costs do not depend on them, as long as no sum leaves the field.

use crate::{field::F, layer::Values, lookup::TABLE_BITS, matmul};

/// SplitMix64 (Steele, Lea, Flood 2014).
pub struct Random(pub u64);

impl Random {
    /// The next 64 bits.
    pub fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// A value of magnitude below 2^`bits`.
    pub fn signed(&mut self, bits: u32) -> i64 {
        (self.bits() >> (63 - bits)) as i64 - (1 << bits)
    }
}

/// Bits of the magnitude of a layer's inputs here. With nine for the weights no sum of 720 products reaches p/2.
pub const INPUT_BITS: usize = 11;
const WEIGHT_BITS: u32 = 9;

/// SiLU as a table: int16 in, int16 out, ten fraction bits both. Floats will do for values that only have to be some.
pub fn silu_table() -> Vec<F> {
    let silu = |x: f64| x / (1.0 + (-x).exp());
    let half = 1i64 << (TABLE_BITS - 1);
    (-half..half).map(|x| F::from_i64((silu(x as f64 / 1024.0) * 1024.0).round() as i64)).collect()
}

/// A layer of `rows` × `inner` inputs and `columns` outputs, padded to `shape`.
pub fn layer(shape: &matmul::Shape, [rows, inner, columns]: [usize; 3], seed: u64) -> Values {
    let mut random = Random(seed);
    let x: Vec<i64> = (0..rows * inner).map(|_| random.signed(INPUT_BITS as u32)).collect();
    let w: Vec<i64> = (0..inner * columns).map(|_| random.signed(WEIGHT_BITS)).collect();
    let half = 1i64 << shape.shift >> 1;
    let mut sums = vec![half; rows * columns];
    for i in 0..rows {
        for k in 0..inner {
            for j in 0..columns {
                sums[i * columns + j] += x[i * inner + k] * w[k * columns + j];
            }
        }
    }
    let narrowed: Vec<i64> = sums.iter().map(|sum| sum >> shape.shift).collect();
    assert!(narrowed.iter().all(|&y| i16::try_from(y).is_ok()), "the synthetic sums fit int16");
    let remainders: Vec<i64> = sums.iter().map(|sum| sum & ((1 << shape.shift) - 1)).collect();
    let table = silu_table();
    let pad = |values: &[i64], columns: usize, row_bits: usize, column_bits: usize, filler: i64| {
        let mut padded = vec![F::from_i64(filler); 1 << (row_bits + column_bits)];
        for (target, row) in padded.chunks_exact_mut(1 << column_bits).zip(values.chunks_exact(columns)) {
            for (target, &value) in target.iter_mut().zip(row) {
                *target = F::from_i64(value);
            }
        }
        padded
    };
    let y = pad(&narrowed, columns, shape.rows, shape.columns, 0);
    let z = y.iter().map(|&value| table[(value + F(1 << 15)).0 as usize]).collect();
    Values {
        x: pad(&x, inner, shape.rows, shape.inner, 0),
        w: pad(&w, columns, shape.inner, shape.columns, 0),
        // A sum of zero narrows to zero and leaves the half that was added.
        remainder: pad(&remainders, columns, shape.rows, shape.columns, half),
        y,
        z,
        table,
    }
}

/// `count` int16 values.
pub fn values(count: usize, seed: u64) -> Vec<F> {
    let mut random = Random(seed);
    (0..count).map(|_| F::from_i64(random.signed(15))).collect()
}

/// Remainders of `bits` bits.
pub fn remainders(count: usize, bits: usize, seed: u64) -> Vec<F> {
    let mut random = Random(seed);
    (0..count).map(|_| F((random.bits() >> (64 - bits)) as u32)).collect()
}
