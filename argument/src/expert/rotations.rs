//! The rotations of queries and keys, which both sides compute.

use super::sizes::{D, N, S, T};
use crate::field::small::{self, Halves};
use crate::field::{Extension, Goldilocks};
use crate::relation::public::Public;
use crate::relation::{Axis, Part};
use alloc::sync::Arc;
use alloc::vec;
use alloc::vec::Vec;
use zk0_circuits::model::arithmetic::tables;
use zk0_circuits::EvalSpec;

/// Cosines and sines, `[position, half]`.
#[derive(Clone)]
pub struct Turns {
    tables: Arc<[Vec<i16>; 2]>,
    half: usize,
}

impl Turns {
    /// Those of a specification, of the positions that tokens of samples with these prefixes have. Others stay zero: computing them costs
    /// the guest more than all else about rotations.
    pub fn new(spec: &EvalSpec, prefixes: &[usize]) -> Self {
        let (half, tokens) = (spec.rope_frequencies.len(), spec.dims.chunk as usize);
        let positions = spec.dims.max_prefix as usize + tokens;
        let mut needed = vec![false; positions];
        for start in prefixes.iter().copied().chain([0]) {
            needed[start..start + tokens].fill(true);
        }
        let mut all = [(); 2].map(|()| vec![0; positions * half]);
        let [cosines, sines] = &mut all;
        let rows = cosines
            .chunks_exact_mut(half)
            .zip(sines.chunks_exact_mut(half));
        for (position, (cosines, sines)) in
            rows.enumerate().filter(|(position, _)| needed[*position])
        {
            let both = cosines.iter_mut().zip(sines).zip(&spec.rope_frequencies);
            for ((cosine, sine), frequency) in both {
                let phase = (position as u32).wrapping_mul(*frequency);
                (*cosine, *sine) = tables::turn(phase);
            }
        }
        Self {
            tables: Arc::new(all),
            half,
        }
    }
}

/// Cosines or sines of the rotations of heads. The first half of a head has the sines' negatives.
pub struct Rotations {
    axes: Vec<Axis>,
    /// For each index on [`N`] whether positions begin after the prefix, if that is an axis.
    after_prefix: Option<Vec<bool>>,
    /// Tokens of each sample's prefix.
    prefixes: Vec<usize>,
    turns: Turns,
    tokens: usize,
    sine: bool,
}

impl Rotations {
    /// For keys, `[T, D, S]`, or with `after_prefix` for queries, `[T, N, D, S]`. Tokens from `tokens` on have zeros.
    pub fn new(
        after_prefix: Option<Vec<bool>>,
        prefixes: Vec<usize>,
        turns: Turns,
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
            turns,
            tokens,
            sine,
        }
    }

    fn table(&self) -> &[i16] {
        &self.turns.tables[self.sine as usize]
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
        let half = self.turns.half;
        if token >= self.tokens || dim >= 2 * half {
            return Goldilocks::ZERO;
        }
        let position = token + if after { prefix } else { 0 };
        let value = self.table()[position * half + dim % half] as i64;
        Goldilocks::from_i64(if self.sine && dim < half {
            -value
        } else {
            value
        })
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
        // Samples with prefixes of one length share their positions.
        let mut starts: Vec<(usize, Extension)> = vec![(0, Extension::ZERO)];
        for (&prefix, &weight) in self.prefixes.iter().zip(&samples[..]) {
            starts[0].1 += before * weight;
            let weight = after * weight;
            match starts[1..].iter_mut().find(|(of, _)| *of == prefix) {
                Some((_, sum)) => *sum += weight,
                None => starts.push((prefix, weight)),
            }
        }
        let half = self.turns.half;
        let mut positions = vec![Extension::ZERO; self.table().len() / half];
        for (start, weight) in starts {
            if weight != Extension::ZERO {
                for (sum, &token) in positions[start..].iter_mut().zip(&tokens[..self.tokens]) {
                    *sum += weight * token;
                }
            }
        }
        let folded = (0..half).map(|index| {
            if self.sine {
                dims[index + half] - dims[index]
            } else {
                dims[index + half] + dims[index]
            }
        });
        let folded: Vec<Halves> = folded.map(Halves::from).collect();
        let rows = self.table().chunks_exact(half).zip(positions);
        let read = rows.filter(|(_, weight)| *weight != Extension::ZERO);
        read.map(|(row, weight)| weight * small::dot(&folded, row))
            .sum()
    }
}
