//! RMSNorm, as [`zk0_circuits::model::elementwise::norm`] computes it.
//!
//! With S = Σ x², the width w and ε at the scale of the mean: `mean = ⌊2^32·S/w⌋ + ε`, `root = ⌊√mean⌋`,
//! `reciprocal = ⌊2^(39 + bits)/root⌋`, and the result is `x · gain · reciprocal`, shifted with rounding. S is at most 2^44 and the mean below
//! 2^62 + 2^46, so that no equation below reaches the modulus.

use crate::expert::builder::{one, power_of_two, times, Builder, Saturating};
use crate::expert::sizes::{F, S};
use crate::relation::along::Along;
use crate::relation::Committed;
use crate::relation::{Atom, Axis, Count, Factor, Monomials};
use alloc::vec;
#[cfg(feature = "prove")]
use zk0_circuits::model::arithmetic::fixed::integer_sqrt;

/// 1e-5 with 32 fraction bits.
const EPS: i64 = 42_950;

/// A norm of rows.
pub struct Norm<'a> {
    /// Names it.
    pub name: &'static str,
    /// The axes of the rows before and after that of their values, of which the second one is that of models. Samples are the last one.
    pub rows: &'a [Axis],
    /// Number of the virtual tensor that is normed.
    pub input: usize,
    /// Number of the gains' view.
    pub gain: usize,
    /// Values in a row.
    pub width: i64,
    /// Fraction bits of the input.
    pub bits: Along,
    /// From products to results.
    pub shift: Along,
    /// Which rows count.
    pub count: Count,
}

impl Norm<'_> {
    /// Adds the norm. Returns the results, on the rows' axes with that of the values before the samples'.
    pub fn relate(self, builder: &mut Builder) -> Committed {
        let (name, count) = (self.name, self.count);
        let rows = [self.rows, &[S]].concat();
        let all = [self.rows, &[F, S]].concat();
        let summed = [&rows[..], &[F]].concat();
        let monomials = |builder: &mut Builder, axes: &[Axis], summed, factors: &[usize]| {
            let factors = factors.iter().map(|&view| Factor::Virtual(view));
            builder.relations.monomials.push(Monomials {
                axes: axes.to_vec(),
                summed,
                terms: vec![(1, factors.collect())],
            });
            Atom::Monomials(builder.relations.monomials.len() - 1)
        };
        let squares = monomials(builder, &summed, 1, &[self.input, self.input]);
        let width = self.width;

        // S = width·whole + rest
        let whole = builder.commit(name, &rows);
        // 2^32·rest = width·fraction + …
        let fraction = builder.commit(name, &rows);
        let root = builder.commit(name, &rows);
        let reciprocal = builder.commit(name, &rows);
        #[cfg(feature = "prove")]
        {
            let (rows, bits) = (rows.clone(), self.bits.clone());
            builder.step(move |filling| {
                let squares = filling.linear(&vec![one(squares)], &rows);
                let bits = filling.along(&bits, &rows);
                let mut values = [(); 4].map(|()| vec![0; squares.len()]);
                for (index, (&squares, bits)) in squares.iter().zip(bits).enumerate() {
                    let (whole, rest) = (squares / width, squares % width);
                    let fraction = (rest << 32) / width;
                    let mean = (whole << 32) + fraction + (EPS << (2 * bits));
                    let root = integer_sqrt(mean as u64) as i64;
                    let reciprocal = (1 << (39 + bits)) / root;
                    for (all, value) in values.iter_mut().zip([whole, fraction, root, reciprocal]) {
                        all[index] = value;
                    }
                }
                for (tensor, values) in [whole, fraction, root, reciprocal]
                    .into_iter()
                    .zip(&mut values)
                {
                    filling.keep_counted(count, &rows, values);
                    filling.set(tensor, &rows, values);
                }
            });
        }
        let below = |builder: &mut Builder, value: &[_], bits: i64| {
            builder.wide_range(name, &rows, count, value.to_vec(), &Along::Everywhere(bits));
        };
        below(builder, &[one(whole.atom())], 31);
        let width_bits = (width as u64).next_power_of_two().trailing_zeros() as i64;
        let rest = [one(squares), times(-width, whole.atom())];
        below(builder, &rest, width_bits);
        let to_width = [
            times(width - 1, Atom::One),
            times(-1, squares),
            times(width, whole.atom()),
        ];
        below(builder, &to_width, width_bits);
        below(builder, &[one(fraction.atom())], 32);
        let rest = [
            times(1 << 32, squares),
            times(-(width << 32), whole.atom()),
            times(-width, fraction.atom()),
        ];
        below(builder, &rest, width_bits);
        let mut to_width = vec![times(width - 1, Atom::One)];
        to_width.extend(rest.map(|term| times(-term.factor, term.atom)));
        below(builder, &to_width, width_bits);

        // root² ≤ mean ≤ root² + 2·root, with root at most 2^31 + 2^14
        let eps = builder.scaled(&self.bits.map(|bits| EPS << (2 * bits)), 1, Atom::One);
        let square = monomials(builder, &rows, 0, &[root.view, root.view]);
        below(builder, &[one(root.atom())], 32);
        below(
            builder,
            &[
                times((1 << 31) + (1 << 14), Atom::One),
                times(-1, root.atom()),
            ],
            32,
        );
        let above = [
            times(1 << 32, whole.atom()),
            one(fraction.atom()),
            eps,
            times(-1, square),
        ];
        below(builder, &above, 33);
        let mut to_next = vec![times(2, root.atom())];
        to_next.extend(above.map(|mut term| {
            term.factor = -term.factor;
            term
        }));
        below(builder, &to_next, 33);

        // reciprocal·root ≤ 2^(39 + bits) < (reciprocal + 1)·root, with reciprocal from 1 to 2^32
        let product = monomials(builder, &rows, 0, &[reciprocal.view, root.view]);
        let power = self.bits.map(|bits| power_of_two(39 + bits));
        below(builder, &[one(reciprocal.atom()), times(-1, Atom::One)], 32);
        let power_term = builder.scaled(&power, 1, Atom::One);
        below(builder, &[power_term, times(-1, product)], 32);
        let power_term = builder.scaled(&power, -1, Atom::One);
        let to_root = [
            one(root.atom()),
            times(-1, Atom::One),
            power_term,
            one(product),
        ];
        below(builder, &to_root, 32);

        // |x·gain·reciprocal| is at most 2^62, half of the shift's power 2^61, and 2^shift times the result at most 2^63: together less than the
        // modulus.
        let scaled = monomials(builder, &all, 0, &[self.input, self.gain, reciprocal.view]);
        let half = self.shift.map(|shift| power_of_two(shift - 1));
        let value = vec![one(scaled), builder.scaled(&half, 1, Atom::One)];
        let within = self.shift.map(|shift| (64 - shift).min(16));
        let result = builder.commit(name, &all);
        // From 2^47 on, what is divided by it fits int16.
        let saturating = Saturating {
            models: self.rows[1],
            bits: self
                .shift
                .map(|shift| if shift < 47 { 63 - shift } else { 0 }),
        };
        let shifts = (&self.shift, Some(&within));
        builder.floor_into(result, &all, count, (value, None), shifts, Some(saturating));
        result
    }
}
