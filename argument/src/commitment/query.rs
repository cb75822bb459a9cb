//! One query of an opening: what is folded is followed from a row to the last message.

use super::parameters::{cap_bits, FOLDS, SIBLINGS};
use crate::field::{Extension, Goldilocks};
use crate::hash::Digest;
use crate::transcript::{require, Refused, Verifier};
use crate::tree;
use alloc::vec::Vec;

/// A codeword that was committed to, and the challenges that fold it into the next one.
pub struct Step {
    pub cap: Vec<Digest>,
    pub challenges: [Extension; FOLDS],
}

/// What all queries share.
pub struct Queries<'a> {
    /// Binary logarithm of the first codeword's length.
    length: u32,
    steps: Vec<Step>,
    message: &'a [Extension],
    /// The generator of the first codeword's points, squared 0, 1, … times, and the inverses.
    squares: Vec<Goldilocks>,
    inverse_squares: Vec<Goldilocks>,
    /// The inverses of the powers of a root of unity of order 2^FOLDS.
    inverse_roots: [Goldilocks; SIBLINGS],
}

impl<'a> Queries<'a> {
    pub fn new(length: u32, steps: Vec<Step>, message: &'a [Extension]) -> Self {
        let generator = Goldilocks::root_of_unity(length);
        let squares =
            |first| core::iter::successors(Some(first), |&x| Some(x * x)).take(length as usize);
        let root = Goldilocks::root_of_unity(FOLDS as u32).inverse();
        Self {
            length,
            steps,
            message,
            squares: squares(generator).collect(),
            inverse_squares: squares(generator.inverse()).collect(),
            inverse_roots: core::array::from_fn(|exponent| root.pow(exponent as u64)),
        }
    }

    /// Reads the leaves at `position`, where the first codeword has to have `value`, and checks them.
    #[inline(always)]
    pub fn check(
        &self,
        verifier: &mut Verifier<'_>,
        mut position: usize,
        mut value: Extension,
    ) -> Result<(), Refused> {
        let mut length = self.length;
        // The inverse of the point at `position` of the codeword.
        let mut inverse = power(&self.inverse_squares, position);
        for step in &self.steps {
            length -= FOLDS as u32;
            let sibling = position >> length;
            position &= (1 << length) - 1;
            let leaf = tree::open(
                verifier,
                &step.cap,
                length - cap_bits(length),
                position,
                &[2 * SIBLINGS],
                0,
            )?;
            let siblings = Extension::of_coefficients(leaf);
            let holds = siblings.get(sibling) == Some(&value);
            require(holds, Refused::Equation("a fold of an opening"))?;
            // From the point at the sibling to that of the first one.
            inverse *= self.inverse_roots[(SIBLINGS - sibling) % SIBLINGS];
            value = self.fold(siblings, &step.challenges, inverse);
            for _ in 0..FOLDS {
                inverse *= inverse;
            }
        }
        let point = power(&self.squares, position << (self.length - length));
        let coefficients = self.message.iter().rev();
        let last = coefficients.fold(Extension::ZERO, |sum, &coefficient| {
            sum.scale(point) + coefficient
        });
        require(
            last == value,
            Refused::Equation("the last message of an opening"),
        )
    }

    /// Folds a leaf. `inverse` is that of its first value's point. With `u` at `x` and `v` at `−x`, one fold is
    /// `((1 − r)·(u + v) + r·(u − v)/x) / 2`.
    #[inline(always)]
    fn fold(
        &self,
        leaf: &[Extension],
        challenges: &[Extension; FOLDS],
        mut inverse: Goldilocks,
    ) -> Extension {
        let mut values: [Extension; SIBLINGS] = core::array::from_fn(|sibling| leaf[sibling]);
        let mut half = SIBLINGS / 2;
        let mut stride = 1;
        for &challenge in challenges {
            for place in 0..half {
                let inverse = match place {
                    0 => inverse,
                    _ => inverse * self.inverse_roots[place * stride],
                };
                let (u, v) = (values[place], values[place + half]);
                let sum = u + v;
                values[place] = sum + challenge * ((u - v).scale(inverse) - sum);
            }
            inverse *= inverse;
            half /= 2;
            stride *= 2;
        }
        const HALVES: Goldilocks = halves();
        values[0].scale(HALVES)
    }
}

/// 2^-FOLDS, which all folds of a leaf leave out.
const fn halves() -> Goldilocks {
    let mut product = Goldilocks::ONE;
    let mut fold = 0;
    while fold < FOLDS {
        product = product.halved();
        fold += 1;
    }
    product
}

/// The power of a generator whose squares are given.
#[inline(always)]
fn power(squares: &[Goldilocks], exponent: usize) -> Goldilocks {
    let chosen = squares
        .iter()
        .enumerate()
        .filter(|(bit, _)| exponent >> bit & 1 == 1);
    chosen.fold(Goldilocks::ONE, |product, (_, &square)| product * square)
}
