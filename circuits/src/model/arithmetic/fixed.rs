//! Fixed-point arithmetic: shifts with explicit rounding, and narrowing that refuses a value that does not fit.

/// A prepared change of fraction bits: an exact shift to the left, or a shift to the right that rounds half up.
#[derive(Clone, Copy)]
pub struct Rescale {
    left: u32,
    half: i64,
    right: u32,
}

impl Rescale {
    /// Prepares the change from `from` fraction bits to `to`.
    #[inline(always)]
    pub fn new(from: i32, to: i32) -> Self {
        let (left, right) = ((to - from).max(0) as u32, (from - to).max(0) as u32);
        Self {
            left,
            half: 1 << right >> 1,
            right,
        }
    }

    /// Returns `value` at the new scale.
    #[inline(always)]
    pub fn apply(self, value: i64) -> i64 {
        ((value << self.left) + self.half) >> self.right
    }
}

/// `value / 2^shift` rounded half up; `shift` ≥ 1.
#[inline(always)]
pub fn round_shift(value: i64, shift: u32) -> i64 {
    (value + (1 << (shift - 1))) >> shift
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

/// The nearest int16.
pub fn saturated(value: i64) -> i16 {
    value.clamp(i16::MIN.into(), i16::MAX.into()) as i16
}

/// Finds out whether values fit int16, at two instructions a value.
#[derive(Default)]
pub struct Range {
    /// Bits of all values plus 2^15.
    seen: u64,
}

impl Range {
    /// Returns `value` as int16. The result for a value out of range is not used.
    #[inline(always)]
    pub fn narrow(&mut self, value: i64) -> i16 {
        self.seen |= value.wrapping_add(1 << 15) as u64;
        value as i16
    }

    /// Whether all values were in range.
    pub fn holds(&self) -> bool {
        self.seen >> 16 == 0
    }
}
