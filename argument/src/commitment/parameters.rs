//! The dimensions of a commitment, and the constants that its strength rests on.

/// Variables that are bound between two commitments to codewords. Leaves hold 2^FOLDS values.
pub const FOLDS: usize = 2;
/// Values of a leaf.
pub const SIBLINGS: usize = 1 << FOLDS;
/// Bits of the proof of work before positions are drawn.
pub const POSITION_WORK: u32 = 22;
/// Binary logarithm of the values of the last message, but for what is left of a tail.
pub const LAST: u32 = 4;
/// Binary logarithm of the digests of a cap.
pub const CAP: u32 = 6;
/// Random elements of a leaf that tell nothing: without them, a guess of a row could be compared with its digest.
pub const SALT: usize = 2;

/// Least and most variables of the columns of samples.
const HEIGHTS: (u32, u32) = (16, 22);

/// Dimensions of all segments of a commitment.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Parameters {
    /// Variables of each polynomial.
    pub(super) height: u32,
    /// Of the code.
    pub(super) rate: Rate,
    /// How many are queried.
    pub(super) positions: usize,
}

/// Length of a message over that of its codeword, but for tails.
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

    /// Positions that are queried: with [`POSITION_WORK`] bits of work, a word that is too far from all codewords passes with probability
    /// 2^-102.4.
    const fn queries(self) -> usize {
        // The least n with ((1 + rate)/2)^n ≤ 2^-80.4, where a tail makes the rate larger by 2^-LAST of it; a test computes them.
        match self {
            Self::Half => 209,
            Self::Quarter => 122,
            Self::Eighth => 99,
            Self::Sixteenth => 89,
        }
    }
}

impl Parameters {
    /// For polynomials in `height` variables, an even number from 12 to 24. `None` for others.
    pub fn new(height: u32, rate: Rate) -> Option<Self> {
        let fits = (12..=24).contains(&height) && height.is_multiple_of(2);
        let parameters = Self::with_positions(height, rate, rate.queries());
        fits.then_some(parameters)
    }

    /// For the columns of samples, where the number of a sample's value has so many bits. Columns are high even where a sample is small: the longer
    /// the tail that hides them, the more often they can be opened.
    pub fn of_samples(bits: u32) -> Self {
        let (least, most) = HEIGHTS;
        let height = bits.clamp(least, most).next_multiple_of(2);
        Self::with_positions(height, Rate::Quarter, Rate::Quarter.queries())
    }

    /// With another number of positions than is safe.
    #[doc(hidden)]
    pub fn with_positions(height: u32, rate: Rate, positions: usize) -> Self {
        Self {
            height,
            rate,
            positions,
        }
    }

    /// Variables of each polynomial.
    pub fn variables(&self) -> usize {
        self.height as usize
    }

    /// How many positions an opening queries. As many random coefficients after a column's values hide it.
    pub fn positions(&self) -> usize {
        self.positions
    }

    /// Most coefficients of a tail.
    pub fn longest_tail(&self) -> usize {
        1 << (self.height - LAST)
    }

    /// Binary logarithm of the codeword's length.
    pub(super) fn length(&self) -> u32 {
        self.height + self.rate.bits()
    }

    /// The leaf with the row at a position. Leaves lie in the order of reversed bits, so that each coset of points is a subtree.
    #[doc(hidden)]
    pub fn leaf(&self, position: usize) -> usize {
        position.reverse_bits() >> (usize::BITS - self.length())
    }

    /// Codewords that are committed to while folding.
    pub(super) fn steps(&self) -> usize {
        (self.height - LAST) as usize / FOLDS
    }
}

/// Binary logarithm of the digests in the cap of a folded codeword's tree of 2^`leaves` leaves.
pub fn cap_bits(leaves: u32) -> u32 {
    CAP.min(leaves)
}
