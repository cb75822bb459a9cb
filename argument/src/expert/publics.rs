//! Tensors that both sides compute: what was drawn, which values count, and rotations.

use super::rotations::{Rotations, Turns};
use super::sample::CACHE_AXES;
use super::sizes::{Kind, Sizes, A, F2, M, N, P, Q, R, S, T, X};
use super::statement::Statement;
use crate::field::small::{self, Halves};
use crate::field::{Extension, Goldilocks};
use crate::relation::public::{Affine, Public, RangeColumn, Ranges, Written};
use crate::relation::{Axis, Part};
use alloc::boxed::Box;
use alloc::vec;
use alloc::vec::Vec;
use zk0_circuits::model::arithmetic::tables;

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
    /// 1 for each value of the prefix's keys or values that is read, `[PC, L, V, D, S]`.
    pub const READ: usize = 14;
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
        let bounds = self.bounds.iter().zip(&samples[..]);
        let total: Extension = bounds.map(|(&bound, &weight)| first[bound] * weight).sum();
        match parts {
            [_, second, _] => total * sums(&second.weights())[self.second],
            _ => total,
        }
    }
}

/// Which keys and values of the prefix are read: those of its tokens, layers, heads and dimensions.
pub struct Read {
    axes: [Axis; 5],
    /// Tokens of each sample's prefix.
    prefixes: Vec<usize>,
    /// Layers, heads and the width of a head.
    bounds: [usize; 3],
}

impl Public for Read {
    fn axes(&self) -> &[Axis] {
        &self.axes
    }

    fn value(&self, indices: &[usize]) -> Goldilocks {
        let &[token, layer, head, dim, sample] = indices else {
            return Goldilocks::ZERO;
        };
        let prefix = self.prefixes.get(sample).copied().unwrap_or_default();
        let within = [layer, head, dim].into_iter().zip(self.bounds);
        let read = token < prefix && within.into_iter().all(|(index, bound)| index < bound);
        Goldilocks::from_u32(read as u32)
    }

    fn at(&self, parts: &[&Part]) -> Extension {
        let [tokens, within @ .., samples] = parts else {
            return Extension::ZERO;
        };
        let (tokens, samples) = (sums(&tokens.weights()), samples.weights());
        let prefixes = self.prefixes.iter().zip(&samples[..]);
        let read: Extension = prefixes
            .map(|(&prefix, &weight)| weight * tokens[prefix])
            .sum();
        let within = within.iter().zip(self.bounds);
        within.fold(read, |product, (part, bound)| {
            product * sums(&part.weights())[bound]
        })
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
        let all = self.samples.iter().zip(&samples[..]);
        all.map(|(&(count, prefix), &weight)| {
            let prefix = places[self.tokens + prefix] - places[self.tokens];
            weight * (any * frames[count] * prefix + of_itself * seen[count])
        })
        .sum()
    }
}

/// Values of each sample that were drawn for it: a matrix whose columns and rows are the indices on two axes, or a row.
pub struct DrawnValues {
    axes: Vec<Axis>,
    /// Values in a row, and in all rows of a sample.
    width: usize,
    size: usize,
    /// One sample after the other, by rows.
    values: Vec<i16>,
}

impl Public for DrawnValues {
    fn axes(&self) -> &[Axis] {
        &self.axes
    }

    fn value(&self, indices: &[usize]) -> Goldilocks {
        let (row, column, sample) = match *indices {
            [row, column, sample] => (row, column, sample),
            [column, sample] => (0, column, sample),
            _ => return Goldilocks::ZERO,
        };
        let number = row * self.width + column;
        if column < self.width && number < self.size {
            self.values
                .get(sample * self.size + number)
                .map_or(Goldilocks::ZERO, |&value| value.into())
        } else {
            Goldilocks::ZERO
        }
    }

    fn at(&self, parts: &[&Part]) -> Extension {
        let (rows, columns, samples) = match parts {
            [rows, columns, samples] => (rows.weights(), columns.weights(), samples.weights()),
            [columns, samples] => (
                vec![Extension::ONE].into(),
                columns.weights(),
                samples.weights(),
            ),
            _ => return Extension::ZERO,
        };
        let columns: Vec<Halves> = columns.iter().map(|&weight| weight.into()).collect();
        let of_sample = |values: &[i16]| -> Extension {
            let all = values.chunks_exact(self.width).zip(&rows[..]);
            all.map(|(row, &weight)| weight * small::dot(&columns, row))
                .sum()
        };
        let all = self.values.chunks_exact(self.size).zip(&samples[..]);
        all.map(|(values, &weight)| weight * of_sample(values))
            .sum()
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
    let rotations = Turns::new(spec, &prefixes);
    let rotations = |after: Option<&Vec<bool>>, sine: bool| {
        let prefixes = prefixes.clone();
        let tokens = dims.chunk as usize;
        Box::new(Rotations::new(
            after.cloned(),
            prefixes,
            rotations.clone(),
            tokens,
            sine,
        ))
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
        Box::new(noise(statement)),
        Box::new(time_embedding(statement)),
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
        Box::new(Read {
            axes: CACHE_AXES,
            bounds: [dims.layers, dims.kv_heads, dims.head_dim].map(|bound| bound as usize),
            prefixes,
        }),
    ]
}

/// Noise, `[T, A, S]`.
fn noise(statement: &Statement) -> DrawnValues {
    let dims = &statement.spec.dims;
    let width = dims.max_action_dim as usize;
    let size = width * dims.chunk as usize;
    let mut values = Vec::with_capacity(size * statement.samples.len());
    for sample in &statement.samples {
        values.extend_from_slice(&sample.draw.noise);
    }
    DrawnValues {
        axes: vec![T, A, S],
        width,
        size,
        values,
    }
}

/// The embedding of flow times, `[F2, S]`: sines, then cosines.
fn time_embedding(statement: &Statement) -> DrawnValues {
    const HALF: i64 = 1 << (tables::TRIG_BITS - 1);
    let spec = &statement.spec;
    let width = 2 * spec.time_frequencies.len();
    let mut values = Vec::with_capacity(width * statement.samples.len());
    let mut cosines = Vec::with_capacity(width / 2);
    // Sines are at most 2^14, and the embedding has at most 14 bits: the result is an int16.
    let rounded =
        |value: i16| ((((value as i64) << spec.embedding) + HALF) >> tables::TRIG_BITS) as i16;
    for sample in &statement.samples {
        let time = sample.draw.time as u64;
        for frequency in &spec.time_frequencies {
            let (cosine, sine) = tables::turn(((time * frequency) >> 16) as u32);
            values.push(rounded(sine));
            cosines.push(rounded(cosine));
        }
        values.append(&mut cosines);
    }
    DrawnValues {
        axes: vec![F2, S],
        width,
        size: width,
        values,
    }
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
