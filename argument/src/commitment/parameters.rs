//! The dimensions of a commitment, and the constants that its strength rests on.

/// Variables that are bound between two commitments to codewords. Leaves hold 2^FOLDS values.
pub const FOLDS: usize = 2;
/// Values of a leaf.
pub const SIBLINGS: usize = 1 << FOLDS;
/// Bits of the proofs of work before columns are combined and before positions are drawn.
pub const WORK: u32 = 16;
/// The last message has up to 2^LAST values, and at least a quarter of that.
pub const LAST: u32 = 4;
/// Binary logarithm of the digests of a cap.
pub const CAP: u32 = 6;

/// Dimensions of all segments of a commitment.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Parameters {
    /// Variables of each polynomial.
    pub(super) height: u32,
    /// Of the code.
    pub(super) rate: Rate,
}

/// Length of a message over that of its codeword.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Rate {
    /// 1/2
    Half,
    /// 1/4
    Quarter,
    /// 1/8
    Eighth,
    /// 1/16
    Sixteenth,
}

impl Rate {
    /// Binary logarithm of the codeword's length over the message's.
    pub const fn bits(self) -> u32 {
        match self {
            Self::Half => 1,
            Self::Quarter => 2,
            Self::Eighth => 3,
            Self::Sixteenth => 4,
        }
    }

    /// Positions that are queried: with [`WORK`] bits of work, a word that is too far from all codewords passes with probability 2^-102.
    pub(super) const fn queries(self) -> usize {
        // The least n with ((1 + rate)/2)^n ≤ 2^-86; a test computes them.
        match self {
            Self::Half => 208,
            Self::Quarter => 127,
            Self::Eighth => 104,
            Self::Sixteenth => 95,
        }
    }
}

impl Parameters {
    /// For polynomials in `height` variables.
    pub fn new(height: u32, rate: Rate) -> Self {
        Self { height, rate }
    }

    /// Variables of each polynomial.
    pub fn variables(&self) -> usize {
        self.height as usize
    }

    /// Binary logarithm of the codeword's length.
    pub(super) fn length(&self) -> u32 {
        self.height + self.rate.bits()
    }

    /// Codewords that are committed to while folding.
    pub(super) fn steps(&self) -> usize {
        (self.height - LAST).div_ceil(FOLDS as u32) as usize
    }
}

/// Binary logarithm of the digests in the cap of a folded codeword's tree of 2^`leaves` leaves.
pub fn cap_bits(leaves: u32) -> u32 {
    CAP.min(leaves)
}
