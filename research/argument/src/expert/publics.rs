//! Tensors that both sides compute: what was drawn, which values count, and rotations.

use super::sizes::{Kind, Sizes, A, D, F2, M, N, P, Q, R, S, T, X};
use super::statement::Statement;
use crate::field::{Extension, Goldilocks};
use crate::relation::public::{Affine, Public, RangeColumn, Ranges, Written};
use crate::relation::{Axis, Part};
use alloc::boxed::Box;
use alloc::vec;
use alloc::vec::Vec;
use zk0_circuits::model::arithmetic::tables;
use zk0_circuits::EvalSpec;

/// Numbers in [`crate::relation::Relations::publics`].
pub mod number {
    /// 1 for each action token that counts, `[T, S]`.
    pub const TOKENS: usize = 0;
    /// Noise, `[T, A, S]`.
    pub const NOISE: usize = 1;
    /// The time embedding, `[F2, S]`.
    pub const TIME: usize = 2;
    /// Cosines for queries, `[T, N, D, S]`.
    pub const QUERY_COSINE: usize = 3;
    /// Sines for queries, likewise.
    pub const QUERY_SINE: usize = 4;
    /// Cosines for keys, `[T, D, S]`.
    pub const KEY_COSINE: usize = 5;
    /// Sines for keys, likewise.
    pub const KEY_SINE: usize = 6;
    /// 1 where an action token sees what is attended to, `[T, N, P, S]`.
    pub const SEEN: usize = 7;
    /// 1 where an error counts, `[T, A, S]`.
    pub const COUNTED: usize = 8;
    /// Sums of squared errors, `[M, S]`.
    pub const LOSSES: usize = 9;
    /// Values of the table of ranges.
    pub const RANGE_VALUE: usize = 10;
    /// Bits of the table of ranges.
    pub const RANGE_BITS: usize = 11;
    /// Rows of a table of gates.
    pub const GATE: usize = 12;
    /// Rows of the table of powers.
    pub const DISTANCE: usize = 13;
}

/// Sums of weights: entry `i` is the sum of the first `i`.
fn sums(weights: &[Extension]) -> Vec<Extension> {
    let mut sums = Vec::with_capacity(weights.len() + 1);
    let mut sum = Extension::ZERO;
    sums.push(sum);
    for &weight in weights {
        sum += weight;
        sums.push(sum);
    }
    sums
}

/// 1 where the index on the first axis is below a bound that each sample has, and the one on the second axis, if any, below another one.
pub struct Below {
    axes: Vec<Axis>,
    bounds: Vec<usize>,
    /// Bound on the second of three axes.
    second: usize,
}

impl Below {
    /// `[T, S]`: tokens that count.
    pub fn tokens(frames: &[usize]) -> Self {
        Self {
            axes: vec![T, S],
            bounds: frames.to_vec(),
            second: 0,
        }
    }

    /// `[T, A, S]`: errors that count.
    pub fn errors(frames: &[usize], action_dim: usize) -> Self {
        Self {
            axes: vec![T, A, S],
            bounds: frames.to_vec(),
            second: action_dim,
        }
    }
}

impl Public for Below {
    fn axes(&self) -> &[Axis] {
        &self.axes
    }

    fn value(&self, indices: &[usize]) -> Goldilocks {
        let (first, rest) = (indices[0], &indices[1..]);
        let sample = rest[rest.len() - 1];
        let below = first < self.bounds.get(sample).copied().unwrap_or_default()
            && (rest.len() == 1 || rest[0] < self.second);
        Goldilocks::from_u32(below as u32)
    }

    fn at(&self, parts: &[&Part]) -> Extension {
        let first = sums(&parts[0].weights());
        let samples = parts[parts.len() - 1].weights();
        let bounds = self.bounds.iter().zip(&samples);
        let total: Extension = bounds.map(|(&bound, &weight)| first[bound] * weight).sum();
        match parts {
            [_, second, _] => total * sums(&second.weights())[self.second],
            _ => total,
        }
    }
}

/// What each action token sees: in self-attention the prefix, and the action tokens up to itself; in cross-attention the prefix.
pub struct Seen {
    axes: [Axis; 4],
    /// Whether an index on [`N`] is a layer of self-attention.
    of_itself: Vec<bool>,
    tokens: usize,
    /// Frames and tokens of the prefix of each sample.
    samples: Vec<(usize, usize)>,
}

impl Seen {
    /// For the sizes and samples of a statement.
    pub fn new(sizes: &Sizes, of_itself: Vec<bool>, samples: Vec<(usize, usize)>) -> Self {
        Self {
            axes: [T, N, P, S],
            of_itself,
            tokens: sizes.count(T),
            samples,
        }
    }
}

impl Public for Seen {
    fn axes(&self) -> &[Axis] {
        &self.axes
    }

    fn value(&self, indices: &[usize]) -> Goldilocks {
        let &[token, n, place, sample] = indices else {
            return Goldilocks::ZERO;
        };
        let (frames, prefix) = self.samples.get(sample).copied().unwrap_or_default();
        let seen = match place.checked_sub(self.tokens) {
            Some(place) => place < prefix,
            None => self.of_itself[n] && place <= token,
        };
        Goldilocks::from_u32((seen && token < frames) as u32)
    }

    fn at(&self, parts: &[&Part]) -> Extension {
        let &[tokens, n, places, samples] = parts else {
            return Extension::ZERO;
        };
        let (tokens, n, samples) = (tokens.weights(), n.weights(), samples.weights());
        let places = sums(&places.weights());
        let frames = sums(&tokens);
        // Of the tokens below a bound, the weights times those of the tokens that they see.
        let seen = tokens.iter().enumerate();
        let seen: Vec<Extension> = seen.map(|(token, &w)| w * places[token + 1]).collect();
        let seen = sums(&seen);
        let of_itself = n.iter().zip(&self.of_itself).filter(|(_, own)| **own);
        let of_itself: Extension = of_itself.map(|(&weight, _)| weight).sum();
        let any: Extension = n.iter().copied().sum();
        let all = self.samples.iter().zip(samples);
        all.map(|(&(count, prefix), weight)| {
            let prefix = places[self.tokens + prefix] - places[self.tokens];
            weight * (any * frames[count] * prefix + of_itself * seen[count])
        })
        .sum()
    }
}

/// Cosines or sines of the rotations of heads. The first half of a head has the sines' negatives.
pub struct Rotations {
    axes: Vec<Axis>,
    /// For each index on [`N`] whether positions begin after the prefix, if that is an axis.
    after_prefix: Option<Vec<bool>>,
    /// Tokens of each sample's prefix.
    prefixes: Vec<usize>,
    /// `[position, half]`.
    table: Vec<i16>,
    half: usize,
    tokens: usize,
    sine: bool,
}

impl Rotations {
    /// For keys, `[T, D, S]`, or with `after_prefix` for queries, `[T, N, D, S]`. `table` has `half` values for each position. Tokens from
    /// `tokens` on have zeros.
    pub fn new(
        after_prefix: Option<Vec<bool>>,
        prefixes: Vec<usize>,
        (table, half): (Vec<i16>, usize),
        tokens: usize,
        sine: bool,
    ) -> Self {
        let axes = match after_prefix {
            Some(_) => vec![T, N, D, S],
            None => vec![T, D, S],
        };
        Self {
            axes,
            after_prefix,
            prefixes,
            table,
            half,
            tokens,
            sine,
        }
    }

    /// `Σ` of the values of all tokens and dimensions, where positions begin at `start`.
    fn from(&self, start: usize, tokens: &[Extension], dims: &[Extension]) -> Extension {
        let folded: Vec<Extension> = (0..self.half)
            .map(|index| {
                let (low, high) = (dims[index], dims[index + self.half]);
                match self.sine {
                    true => high - low,
                    false => high + low,
                }
            })
            .collect();
        let rows = self.table[start * self.half..].chunks_exact(self.half);
        let rows = rows.zip(tokens).take(self.tokens);
        rows.map(|(row, &weight)| {
            let row: Vec<Goldilocks> = row.iter().map(|&value| value.into()).collect();
            weight * Extension::dot(&folded, &row)
        })
        .sum()
    }
}

impl Public for Rotations {
    fn axes(&self) -> &[Axis] {
        &self.axes
    }

    fn value(&self, indices: &[usize]) -> Goldilocks {
        let (token, dim) = (indices[0], indices[indices.len() - 2]);
        let Some(&prefix) = self.prefixes.get(indices[indices.len() - 1]) else {
            return Goldilocks::ZERO;
        };
        let after = self.after_prefix.as_ref().is_none_or(|all| all[indices[1]]);
        if token >= self.tokens || dim >= 2 * self.half {
            return Goldilocks::ZERO;
        }
        let position = token + if after { prefix } else { 0 };
        let value = self.table[position * self.half + dim % self.half] as i64;
        Goldilocks::from_i64(if self.sine && dim < self.half { -value } else { value })
    }

    fn at(&self, parts: &[&Part]) -> Extension {
        let tokens = parts[0].weights();
        let dims = parts[parts.len() - 2].weights();
        let samples = parts[parts.len() - 1].weights();
        let (mut after, mut before) = (Extension::ONE, Extension::ZERO);
        if let Some(all) = &self.after_prefix {
            let weights = parts[1].weights();
            let of = |which: bool| {
                let chosen = weights.iter().zip(all).filter(|(_, own)| **own == which);
                chosen.map(|(&weight, _)| weight).sum()
            };
            (after, before) = (of(true), of(false));
        }
        let mut total = Extension::ZERO;
        if before != Extension::ZERO {
            let all: Extension = self.prefixes.iter().zip(&samples).map(|(_, &w)| w).sum();
            total += before * all * self.from(0, &tokens, &dims);
        }
        // Most samples have prefixes of one length.
        let mut known: Vec<(usize, Extension)> = vec![];
        for (&prefix, &weight) in self.prefixes.iter().zip(&samples) {
            match known.iter_mut().find(|(of, _)| *of == prefix) {
                Some((_, sum)) => *sum += weight,
                None => known.push((prefix, weight)),
            }
        }
        for (prefix, weight) in known {
            total += after * weight * self.from(prefix, &tokens, &dims);
        }
        total
    }
}

/// All public tensors of a statement, in the order of [`number`].
pub fn all(statement: &Statement, sizes: &Sizes) -> Vec<Box<dyn Public>> {
    let (spec, samples) = (&statement.spec, &statement.samples);
    let dims = &spec.dims;
    let frames: Vec<usize> = samples.iter().map(|sample| sample.frames).collect();
    let prefixes: Vec<usize> = samples.iter().map(|sample| sample.prefix).collect();
    let kinds = (0..sizes.count(N)).map(|n| matches!(sizes.kind(n), Some(Kind::OfItself(_))));
    let of_itself: Vec<bool> = kinds.collect();
    let rotations = |after: Option<&Vec<bool>>, sine: bool| {
        let half = spec.rope_frequencies.len();
        let table = rotation_table(spec, sine);
        let prefixes = prefixes.clone();
        let tokens = dims.chunk as usize;
        Box::new(Rotations::new(after.cloned(), prefixes, (table, half), tokens, sine))
    };
    let written = |axes: &[Axis], values| {
        Box::new(Written {
            axes: axes.to_vec(),
            bits: axes.iter().map(|&axis| sizes.of(axis)).collect(),
            values,
        })
    };
    let ranges = |column| Box::new(Ranges { axis: [R], column });
    let rows = |axis, start| {
        let axis = [axis];
        Box::new(Affine { axis, start })
    };
    let both: Vec<(usize, usize)> = frames.iter().copied().zip(prefixes.clone()).collect();
    let losses: Vec<[u64; 2]> = samples.iter().map(|sample| sample.losses).collect();
    vec![
        Box::new(Below::tokens(&frames)),
        written(&[T, A, S], noise(statement, sizes)),
        written(&[F2, S], time_embedding(statement, sizes)),
        rotations(Some(&of_itself), false),
        rotations(Some(&of_itself), true),
        rotations(None, false),
        rotations(None, true),
        Box::new(Seen::new(sizes, of_itself, both)),
        Box::new(Below::errors(&frames, dims.action_dim as usize)),
        written(&LOSS_AXES, self::losses(&losses, sizes.count(S))),
        ranges(RangeColumn::Value),
        ranges(RangeColumn::Bits),
        rows(Q, -(1 << 15)),
        rows(X, 0),
    ]
}

/// `[position, half]`.
fn rotation_table(spec: &EvalSpec, sine: bool) -> Vec<i16> {
    let positions = 0..spec.dims.max_prefix + spec.dims.chunk;
    let rows = positions.flat_map(|position| {
        let phases = spec.rope_frequencies.iter();
        phases.map(move |&frequency| position.wrapping_mul(frequency))
    });
    match sine {
        true => rows.map(tables::sine).collect(),
        false => rows.map(tables::cosine).collect(),
    }
}

/// Noise, `[T, A, S]`.
fn noise(statement: &Statement, sizes: &Sizes) -> Vec<Goldilocks> {
    let (tokens, actions) = (sizes.count(T), sizes.count(A));
    let width = statement.spec.dims.max_action_dim as usize;
    let mut values = vec![Goldilocks::ZERO; tokens * actions * sizes.count(S)];
    for (sample, values) in statement.samples.iter().zip(values.chunks_exact_mut(tokens * actions)) {
        for (token, row) in sample.draw.noise.chunks_exact(width).enumerate() {
            for (action, &value) in row.iter().enumerate() {
                values[token + action * tokens] = value.into();
            }
        }
    }
    values
}

/// The embedding of flow times, `[F2, S]`: sines, then cosines.
fn time_embedding(statement: &Statement, sizes: &Sizes) -> Vec<Goldilocks> {
    let spec = &statement.spec;
    let width = sizes.count(F2);
    let mut values = vec![Goldilocks::ZERO; width * sizes.count(S)];
    for (sample, values) in statement.samples.iter().zip(values.chunks_exact_mut(width)) {
        let phase = |&frequency: &u64| ((sample.draw.time as u64 * frequency) >> 16) as u32;
        let phases = || spec.time_frequencies.iter().map(phase);
        let both = phases().map(tables::sine).chain(phases().map(tables::cosine));
        for (target, value) in values.iter_mut().zip(both) {
            let half = 1 << (tables::TRIG_BITS - 1);
            let rounded = (((value as i64) << spec.embedding) + half) >> tables::TRIG_BITS;
            *target = Goldilocks::from_i64(rounded);
        }
    }
    values
}

/// Losses, `[M, S]`.
fn losses(all: &[[u64; 2]], samples: usize) -> Vec<Goldilocks> {
    let mut values = vec![Goldilocks::ZERO; 2 * samples];
    for (sample, losses) in all.iter().enumerate() {
        for (model, &loss) in losses.iter().enumerate() {
            values[2 * sample + model] = Goldilocks::from_i64(loss as i64);
        }
    }
    values
}

/// The axes of [`losses`].
pub const LOSS_AXES: [Axis; 2] = [M, S];
