//! Fixed-point arithmetic: shifts with explicit rounding, narrowing that refuses what does not fit, and the int16
//! matrix product.

/// `value` with `from` fraction bits, restated with `to`: exact to the left, rounded half up to the right.
#[inline(always)]
pub fn align(value: i64, from: i32, to: i32) -> i64 {
    if to >= from {
        value << (to - from)
    } else {
        round_shift(value, (from - to) as u32)
    }
}

/// `value / 2^shift` rounded half up; `shift` ≥ 1.
#[inline(always)]
pub fn round_shift(value: i64, shift: u32) -> i64 {
    (value + (1 << (shift - 1))) >> shift
}

/// `numerator / denominator` rounded to nearest, ties away from zero; `denominator` > 0.
#[inline(always)]
pub fn round_divide(numerator: i64, denominator: i64) -> i64 {
    let half = denominator >> 1;
    if numerator < 0 {
        (numerator - half) / denominator
    } else {
        (numerator + half) / denominator
    }
}

/// Largest integer whose square is at most `value`.
pub fn integer_sqrt(value: u64) -> u64 {
    if value < 2 {
        return value;
    }
    // Newton's iteration from above decreases until it reaches the root.
    let mut root = 1u64 << (64 - value.leading_zeros()).div_ceil(2);
    loop {
        let next = (root + value / root) >> 1;
        if next >= root {
            return root;
        }
        root = next;
    }
}

/// Narrows results to int16 and remembers the first that does not fit: out of range is an error, never a clamp.
pub struct Narrow {
    /// First value that did not fit, if any.
    pub refused: Option<i64>,
}

impl Narrow {
    /// Nothing refused yet.
    pub fn new() -> Self {
        Self { refused: None }
    }

    /// `value` as int16. What it returns for a value out of range is never used.
    #[inline(always)]
    pub fn narrow(&mut self, value: i64) -> i16 {
        let narrowed = value as i16;
        if narrowed as i64 != value {
            self.refuse(value);
        }
        narrowed
    }

    #[cold]
    #[inline(never)]
    fn refuse(&mut self, value: i64) {
        self.refused.get_or_insert(value);
    }
}

/// Σ a·b over equally long slices. |a·b| ≤ 2^30, so that 2^16 terms stay far inside int64.
#[inline(always)]
pub fn dot(a: &[i16], b: &[i16]) -> i64 {
    let mut sum = 0;
    let (a8, b8) = (a.chunks_exact(8), b.chunks_exact(8));
    let (a_rest, b_rest) = (a8.remainder(), b8.remainder());
    for (a, b) in a8.zip(b8) {
        sum += a[0] as i64 * b[0] as i64
            + a[1] as i64 * b[1] as i64
            + a[2] as i64 * b[2] as i64
            + a[3] as i64 * b[3] as i64
            + a[4] as i64 * b[4] as i64
            + a[5] as i64 * b[5] as i64
            + a[6] as i64 * b[6] as i64
            + a[7] as i64 * b[7] as i64;
    }
    for (&a, &b) in a_rest.iter().zip(b_rest) {
        sum += a as i64 * b as i64;
    }
    sum
}
