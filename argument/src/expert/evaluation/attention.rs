//! Softmax attention, as [`zk0_circuits::model::eval`] computes it.
//!
//! With m the largest score that a token sees, s a score, and a factor and shift that follow from the scales, the evaluation takes
//! `2^(−d)` from a table, `d = ⌊((m − s)·factor + 2^(shift−1)) / 2^shift⌋`. Here `g = ⌊(m − s)·factor / 2^(shift−1)⌋` is committed to. Then
//! `d = ⌊(g + 1)/2⌋`, and g ≥ 0 shows that no score is above m. That m is one of the scores is shown by a look-up among them.

use crate::expert::builder::{one, power_of_two, times, Builder, Saturating, Tag};
use crate::expert::publics::number;
use crate::expert::sizes::{D, H, N, P, S, T, X};
use crate::relation::along::Along;
use crate::relation::Committed;
use crate::relation::{Atom, Count, Factor, Monomials, Product, Summed};
use alloc::vec;
use alloc::vec::Vec;
use zk0_circuits::model::arithmetic::fixed::integer_sqrt;
use zk0_circuits::model::multiply::{ATTENTION_BITS, MIX_SHIFT};

/// Fraction bits of the factor.
const FACTOR_BITS: i64 = 20;
/// `log2(e)^2 · 2^(2·FACTOR_BITS)`, rounded.
const LOG2_E_SQUARED: u64 = 2_288_489_396_308;
/// Fraction bits of a table's argument.
const EXPONENT_BITS: i64 = 10;
/// Fraction bits of the reciprocal of the sum of powers.
const RECIPROCAL_BITS: i64 = 48;

const DISTANCE: &str = "distance to the largest score";

const TOKENS: Count = Count::Masked(number::TOKENS);
const SEEN: Count = Count::Masked(number::SEEN);

/// What differences of scores are multiplied with.
pub fn factor(head_dim: u32) -> i64 {
    integer_sqrt(LOG2_E_SQUARED / head_dim as u64) as i64
}

/// From such a product to a distance, for scores with so many fraction bits: one less than the shift to the table's argument.
pub fn shift(score_bits: i64) -> i64 {
    score_bits + FACTOR_BITS - EXPONENT_BITS - 1
}

/// Softmax attention of all layers.
pub struct Attention {
    /// Queries, `[T, N, H, D, S]`.
    pub queries: usize,
    /// What is attended to: keys, `[N, H, P, D, S]`.
    pub keys: usize,
    /// Their values, likewise.
    pub values: usize,
    /// Fraction bits of scores.
    pub score_bits: Along,
    /// Width of a head.
    pub head_dim: u32,
}

impl Attention {
    /// Adds the attention. Returns what it gives, `[T, N, H, D, S]`.
    pub fn relate(self, builder: &mut Builder) -> Committed {
        let each = [T, N, H, P, S];
        let rows = [T, N, H, S];
        builder.relations.products.push(Product {
            left: self.queries,
            right: self.keys,
            left_axes: vec![T],
            right_axes: vec![P],
            shared: vec![N, H, S],
            summed: vec![D],
        });
        let score = Atom::Product(builder.relations.products.len() - 1);
        let factor = factor(self.head_dim);
        let shift = self.score_bits.map(shift);

        let largest = builder.commit("largest score", &rows);
        let chosen = builder.commit("how often a score is the largest", &each);
        let distance = builder.commit(DISTANCE, &each);
        let power = builder.commit("power of a distance", &each);
        // By how much a distance exceeds the largest one in the table, whose power is zero
        let further = builder.saturates.then(|| builder.commit(DISTANCE, &each));
        #[cfg(feature = "prove")]
        fill::scores(
            builder,
            score,
            [largest, distance, power],
            further,
            factor,
            &shift,
        );
        let row_number = |builder: &mut Builder| {
            let mut stride = 1;
            let mut terms = vec![];
            // Each instance has look-ups of its own, so that rows of others need no other numbers.
            for axis in [T, N, H] {
                let count = builder.sizes.count(axis);
                let numbers = Along::Axis(axis, (0..count as i64).map(|n| n * stride).collect());
                terms.push(builder.scaled(&numbers, 1, Atom::One));
                stride *= count as i64;
            }
            terms
        };
        let seen = || vec![one(Atom::Public(number::SEEN))];
        let tag = |tag: Tag| vec![times(tag.number(), Atom::One)];
        let own = row_number(builder);
        let entry = [vec![one(score)], own.clone(), seen()];
        builder.look_up(
            "scores",
            &each,
            Count::Offered(chosen.view),
            entry,
            tag(Tag::Score),
        );
        let entry = [vec![one(largest.atom())], own, vec![one(Atom::One)]];
        builder.look_up("largest score", &rows, TOKENS, entry, tag(Tag::Score));

        let mut rest = vec![
            times(factor, largest.atom()),
            times(-factor, score),
            builder.scaled(&shift.map(power_of_two), -1, distance.atom()),
        ];
        if let Some(further) = further {
            let value = vec![one(further.atom())];
            // A difference of scores times the factor is below 2^59.
            let bits = shift.map(|shift| 59 - shift);
            builder.wide_range(DISTANCE, &each, SEEN, value, &bits);
            let most = builder.sizes.count(X) as i64 - 1;
            builder.at_limit(DISTANCE, &each, (further.view, most), distance);
            rest.push(builder.scaled(&shift.map(power_of_two), -1, further.atom()));
        }
        builder.wide_range(DISTANCE, &each, SEEN, rest, &shift);
        let entry = [vec![one(distance.atom())], vec![one(power.atom())], seen()];
        builder.look_up(
            "power of a distance",
            &each,
            Count::Each,
            entry,
            tag(Tag::Power),
        );

        // The reciprocal of the sum of all powers, which is at least 2^15, that of the largest score
        builder.relations.sums.push(Summed {
            of: power.view,
            axes: vec![P],
        });
        let total = builder.commit("sum of powers", &rows);
        let reciprocal = builder.commit("reciprocal of a sum of powers", &rows);
        let sum = Atom::Summed(builder.relations.sums.len() - 1);
        #[cfg(feature = "prove")]
        fill::reciprocal(builder, sum, total, reciprocal);
        builder
            .relations
            .equalities
            .push(crate::relation::Equality {
                name: "sum of powers",
                axes: rows.to_vec(),
                linear: vec![one(sum), times(-1, total.atom())],
            });
        let monomial = |builder: &mut Builder, axes: &[_], factors: [usize; 2]| {
            builder.relations.monomials.push(Monomials {
                axes: axes.to_vec(),
                summed: 0,
                terms: vec![(1, factors.map(Factor::Virtual).to_vec())],
            });
            Atom::Monomials(builder.relations.monomials.len() - 1)
        };
        let product = monomial(builder, &rows, [reciprocal.view, total.view]);
        let bits = Along::Everywhere(15 + builder.sizes.of(P) as i64);
        let name = "reciprocal of a sum of powers";
        let value = vec![one(reciprocal.atom())];
        builder.wide_range(name, &rows, TOKENS, value, &Along::Everywhere(34));
        let rest = vec![times(1 << RECIPROCAL_BITS, Atom::One), times(-1, product)];
        builder.wide_range(name, &rows, TOKENS, rest, &bits);
        let to_total = vec![
            one(total.atom()),
            times(-1, Atom::One),
            times(-1 << RECIPROCAL_BITS, Atom::One),
            one(product),
        ];
        builder.wide_range(name, &rows, TOKENS, to_total, &bits);

        // Where a score is not seen, its power is 0, and so is its weight.
        let product = monomial(builder, &each, [power.view, reciprocal.view]);
        let shift = RECIPROCAL_BITS - ATTENTION_BITS as i64;
        let value = vec![one(product), times(1 << (shift - 1), Atom::One)];
        let shift = Along::Everywhere(shift);
        let name = "attention weight";
        let weight = builder.floor(name, &each, Count::Each, value, &shift, None);

        builder.relations.products.push(Product {
            left: weight.view,
            right: self.values,
            left_axes: vec![T],
            right_axes: vec![D],
            shared: vec![N, H, S],
            summed: vec![P],
        });
        let mixed = Atom::Product(builder.relations.products.len() - 1);
        let value = vec![times(1 << MIX_SHIFT, mixed), times(1 << 15, Atom::One)];
        let axes: Vec<_> = [T, N, H, D, S].to_vec();
        let shift = Along::Everywhere(16);
        let saturating = Saturating {
            models: N,
            bits: Along::Everywhere(17 + builder.sizes.of(P) as i64),
        };
        builder.floor("attention", &axes, TOKENS, value, &shift, Some(saturating))
    }
}

/// How the prover gets the values.
#[cfg(feature = "prove")]
mod fill {
    use super::*;
    use rayon::prelude::*;
    use zk0_circuits::model::arithmetic::tables::exp2_negative;

    /// Rows whose largest scores one core finds at a time.
    const ROWS: usize = 1 << 10;

    /// The largest score of each row that is seen, the distances to it, and their powers.
    pub fn scores(
        builder: &mut Builder,
        score: Atom,
        [largest, distance, power]: [Committed; 3],
        further: Option<Committed>,
        factor: i64,
        shift: &Along,
    ) {
        let shift = shift.clone();
        let (each, rows) = ([T, N, H, P, S], [T, N, H, S]);
        builder.step(move |filling| {
            let scores = filling.linear(&vec![one(score)], &each);
            let seen = filling.linear(&vec![one(Atom::Public(number::SEEN))], &each);
            let shifts = filling.along(&shift, &each);
            let size = |axis| filling.relations.bits(axis);
            // The index on P stands above those of rows: scores of neighbouring rows at one place lie side by side.
            let (low, places) = (size(T) + size(N) + size(H), 1 << size(P));
            let rows_of_one = 1usize << low;
            let mut largests = vec![0; 1 << filling.relations.size(&rows)];
            let mut all = [(); 3].map(|()| vec![0; scores.len()]);
            let reach = match further {
                Some(_) => (1 << size(X)) - 1,
                None => i64::MAX,
            };
            let of_one = largests.chunks_mut(rows_of_one).enumerate();
            of_one.for_each(|(sample, largests)| {
                let blocks = largests.par_chunks_mut(ROWS).enumerate();
                blocks.for_each(|(block, largests)| {
                    let mut most = [i64::MIN; ROWS];
                    for place in sample * places..(sample + 1) * places {
                        let own = (place << low) + block * ROWS..;
                        let pairs = scores[own.clone()].iter().zip(&seen[own]);
                        for (most, (&score, &seen)) in most.iter_mut().zip(pairs) {
                            *most = if seen == 1 { score.max(*most) } else { *most };
                        }
                    }
                    for (largest, most) in largests.iter_mut().zip(most) {
                        *largest = if most == i64::MIN { 0 } else { most };
                    }
                });
            });
            let [distances, powers, excesses] = &mut all;
            let targets = distances.par_chunks_mut(rows_of_one);
            let targets = targets.zip(powers.par_chunks_mut(rows_of_one));
            let targets = targets
                .zip(excesses.par_chunks_mut(rows_of_one))
                .enumerate();
            targets.for_each(|(place, ((distances, powers), excesses))| {
                let largests = &largests[place / places * rows_of_one..];
                for row in 0..rows_of_one {
                    let at = (place << low) + row;
                    if seen[at] == 1 {
                        let distance = ((largests[row] - scores[at]) * factor) >> shifts[at];
                        distances[row] = distance.min(reach);
                        powers[row] = exp2_negative((distance as u64 + 1) >> 1) as i64;
                        excesses[row] = distance - distance.min(reach);
                    }
                }
            });
            filling.set(largest, &rows, &largests);
            let tensors = [Some(distance), Some(power), further];
            for (tensor, values) in tensors.into_iter().zip(&all) {
                if let Some(tensor) = tensor {
                    filling.set(tensor, &each, values);
                }
            }
        });
    }

    /// The sums of powers, and their reciprocals.
    pub fn reciprocal(builder: &mut Builder, sum: Atom, total: Committed, reciprocal: Committed) {
        let rows = [T, N, H, S];
        builder.step(move |filling| {
            let sums = filling.linear(&vec![one(sum)], &rows);
            let reciprocals: Vec<i64> = sums
                .iter()
                .map(|&sum| (1 << RECIPROCAL_BITS) / sum.max(1))
                .collect();
            filling.set(total, &rows, &sums);
            filling.set(reciprocal, &rows, &reciprocals);
        });
    }
}
