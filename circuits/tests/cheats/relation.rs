//! Small integers that a product check does not see: a combination of coefficients that is zero modulo its prime.

use zk0_circuits::freivalds::coefficients::{Coefficient, Coefficients};
use zk0_circuits::freivalds::field::MODULUS;

/// Integers, not all zero, whose inner product with coefficients `first .. first + count` is a multiple of the modulus.
///
/// Euclid's algorithm on many numbers at once (Brun, 1919): the largest is reduced by the next largest, until one is zero.
/// Every number stays a known combination of those at the start. They shrink together, so that the combination found is not
/// much larger than it has to be: some 107 / `count` bits.
pub fn relation(coefficients: &Coefficients, first: usize, count: usize) -> Vec<i64> {
    let coefficients = coefficients.range(first, count);
    let unit = |at: usize, sign: i64| (0..count).map(|i| if i == at { sign } else { 0 }).collect();
    let mut numbers: Vec<(u128, Vec<i64>)> = vec![(MODULUS, vec![0; count])];
    for (at, coefficient) in coefficients.iter().enumerate() {
        let value = compose(coefficient);
        numbers.push((value.unsigned_abs(), unit(at, value.signum() as i64)));
    }
    loop {
        numbers.sort_by_key(|(value, _)| std::cmp::Reverse(*value));
        let (head, tail) = numbers.split_at_mut(1);
        let (largest, next) = (&mut head[0], &tail[0]);
        let times = largest.0 / next.0;
        largest.0 -= times * next.0;
        for (a, b) in largest.1.iter_mut().zip(&next.1) {
            *a -= times as i64 * b;
        }
        if largest.0 == 0 {
            return largest.1.clone();
        }
    }
}

fn compose(coefficient: &Coefficient) -> i128 {
    let limbs = coefficient.iter().rev();
    limbs.fold(0, |sum, &limb| (sum << 26) + limb as i128)
}
