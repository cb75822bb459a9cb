//! One query of an opening: what is folded is followed from a row to the last message.

use super::parameters::{cap_bits, FOLDS, SIBLINGS};
use crate::field::{Extension, Goldilocks};
use crate::hash::SpongeDigest;
use crate::transcript::{require, Refused, Verifier};
use crate::tree;
use alloc::vec::Vec;

/// A codeword that was committed to, and the challenges that fold it into the next one.
pub struct FoldStep {
    pub cap: Vec<SpongeDigest>,
    pub challenges: [Extension; FOLDS],
}

/// What all queries share.
pub struct Queries<'a> {
    /// Binary logarithm of the first codeword's length.
    length: u32,
    /// The steps, and the weights of a leaf's coefficients in what it folds into.
    steps: Vec<(FoldStep, [Extension; SIBLINGS])>,
    message: &'a [Extension],
    /// The generator of the first codeword's points, squared 0, 1, … times, and the inverses.
    squares: Vec<Goldilocks>,
    inverse_squares: Vec<Goldilocks>,
    /// The inverses of the powers of a root of unity of order 2^FOLDS.
    inverse_roots: [Goldilocks; SIBLINGS],
}

impl<'a> Queries<'a> {
    pub fn new(length: u32, steps: Vec<FoldStep>, message: &'a [Extension]) -> Self {
        let generator = Goldilocks::root_of_unity(length);
        let squares =
            |first| core::iter::successors(Some(first), |&x| Some(x * x)).take(length as usize);
        let root = Goldilocks::root_of_unity(FOLDS as u32).inverse();
        let steps = steps.into_iter().map(|step| {
            let weights = weights(step.challenges);
            (step, weights)
        });
        Self {
            length,
            steps: steps.collect(),
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
        for (step, weights) in &self.steps {
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
            let square = inverse * inverse;
            let powers = [inverse, square, square * inverse];
            value = self.fold(siblings, weights, powers);
            inverse = square * square;
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

    /// Folds a leaf twice: its values are those of a polynomial of degree 3 at x, i·x, i²·x and i³·x, where i² = −1, and its coefficients times the
    /// weights are added. `powers` are those of 1/x.
    #[inline(always)]
    fn fold(
        &self,
        leaf: &[Extension],
        weights: &[Extension; SIBLINGS],
        powers: [Goldilocks; SIBLINGS - 1],
    ) -> Extension {
        let [a, b, c, d] = core::array::from_fn(|sibling| leaf[sibling]);
        let (even, odd) = (a + c, b + d);
        let (difference, turned) = (a - c, (b - d).scale(self.inverse_roots[1]));
        // The coefficients times 4 and powers of x
        let coefficients = [
            even + odd,
            difference + turned,
            even - odd,
            difference - turned,
        ];
        let [constant, rest @ ..] = *weights;
        let [linear, square, cube] = core::array::from_fn(|place| rest[place].scale(powers[place]));
        Extension::dot_of_extensions(&[constant, linear, square, cube], &coefficients)
    }
}

/// What a leaf's coefficients are multiplied with: those of even powers of x with 1 − r, and the others with r, in each fold; and by 1/4.
fn weights([first, second]: [Extension; FOLDS]) -> [Extension; SIBLINGS] {
    let odd = first * second;
    let weights = [
        Extension::ONE - first - second + odd,
        first - odd,
        second - odd,
        odd,
    ];
    weights.map(|weight| weight.halved().halved())
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
