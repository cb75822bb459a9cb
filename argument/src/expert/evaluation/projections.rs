//! Queries, keys and values of all layers: projections, and the rotations of queries and keys.

use super::attention::Attention;
use super::layers::Building;
use super::linear::{Layer, WeightedInput, Which};
use crate::expert::builder::{times, Builder, Saturating};
use crate::expert::publics::number;
use crate::expert::sizes::*;
use crate::expert::weights::Flat;
use crate::relation::along::Along;
use crate::relation::Committed;
use crate::relation::Factor;
use crate::relation::{Atom, Axis, Count, Index, Monomials};
use alloc::vec;
use alloc::vec::Vec;
use zk0_circuits::model::arithmetic::tables::TRIG_BITS;
use zk0_circuits::model::linear::{first_of_layer, place};
use Index::{Mapped, Of};

const TOKENS: Count = Count::Masked(number::TOKENS);
const OWN: [Axis; 5] = [T, SN, V, D, S];
const PREFIX: [Axis; 5] = [PC, CN, V, D, S];

impl Building<'_> {
    /// All that attention needs, but the scale of its scores.
    pub fn projections(
        &mut self,
        normed: Committed,
        cached_keys: Committed,
        cached_values: Committed,
        query: Flat,
    ) -> Attention {
        let dims = self.source.statement.spec.dims;
        let width = dims.expert_width as usize;
        let queries = [T, N, H, D, S];
        let plain = self.add(Layer {
            name: "query",
            axes: &queries,
            count: TOKENS,
            rows: query,
            row_axes: &[H, D],
            last: (N, self.matrices(place::QUERY, 0)),
            is_gate: false,
            factors: vec![WeightedInput {
                input: normed.view,
                columns: Flat::one(F, width),
                first: 0,
                left: &[T, S],
                summed: &[F],
                shared: true,
            }],
        });
        let trigonometric = [number::QUERY_COSINE, number::QUERY_SINE];
        let rotated = self.rotated("rotated query", &queries, plain, trigonometric);

        // The action tokens' own keys and values, in self-attention
        let layers = self.layers_of(SN);
        let to_layer = self.builder.map(SN, |number| layers[number]);
        let view = [Of(T), Mapped(SN, to_layer), Of(F), Of(S)];
        let input = self.builder.view(normed.tensor, &view);
        let mut own = vec![];
        for (output, name) in [(1, "own key"), (2, "own value")] {
            own.push(self.add(Layer {
                name,
                axes: &OWN,
                count: TOKENS,
                rows: self.key_value((D, V)),
                row_axes: &[V, D],
                last: (SN, self.matrices_of(SN, place::QUERY, output)),
                is_gate: false,
                factors: vec![WeightedInput {
                    input,
                    columns: Flat::one(F, width),
                    first: 0,
                    left: &[T, S],
                    summed: &[F],
                    shared: true,
                }],
            }));
        }
        let trigonometric = [number::KEY_COSINE, number::KEY_SINE];
        let own_keys = self.rotated("rotated key", &OWN, own[0], trigonometric);

        // Those of the prefix, in cross-attention
        let mut crossed = vec![];
        if self.builder.sizes.has_cross() {
            for (linear, name, cached) in [
                (place::KEY, "key of the prefix", cached_keys),
                (place::VALUE, "value of the prefix", cached_values),
            ] {
                crossed.push(self.crossed(linear, name, cached));
            }
        }
        let keys = self.attended(own_keys, cached_keys, crossed.first().copied());
        let values = self.attended(own[1], cached_values, crossed.get(1).copied());
        Attention {
            queries: rotated.view,
            keys,
            values,
            score_bits: Along::Everywhere(0),
            head_dim: dims.head_dim,
        }
    }

    fn key_value(&self, (inner, outer): (Axis, Axis)) -> Flat {
        let dims = self.source.statement.spec.dims;
        let inner = (inner, dims.head_dim as usize);
        Flat::two(inner, (outer, dims.kv_heads as usize))
    }

    /// For each index on `axis`, [`SN`] or [`CN`], the index on [`N`] of that layer.
    fn layers_of(&self, axis: Axis) -> Vec<Option<usize>> {
        let sizes = &self.builder.sizes;
        let mut layers = vec![None; sizes.count(axis)];
        for n in 0..sizes.count(N) {
            if let Some(number) = sizes.kind(n).and_then(of_kind(axis)) {
                layers[number] = Some(n);
            }
        }
        layers
    }

    fn matrices_of(&self, axis: Axis, linear: usize, output: usize) -> Vec<Option<Which>> {
        let layers = self.layers_of(axis);
        let sizes = &self.builder.sizes;
        let which = |n: usize| {
            let (model, layer) = sizes.layer(n);
            Which {
                model,
                linear: first_of_layer(layer) + linear,
                output,
            }
        };
        layers.into_iter().map(|n| n.map(which)).collect()
    }

    fn crossed(&mut self, linear: usize, name: &'static str, cached: Committed) -> Committed {
        let layers = self.layers_of(CN);
        let sizes = self.builder.sizes.clone();
        let layer = |number: usize| layers[number].map(|n| sizes.layer(n).1);
        let layer = self.builder.map(CN, layer);
        let view = [Of(PC), Mapped(CN, layer), Of(V2), Of(D2), Of(S)];
        let input = self.builder.view(cached.tensor, &view);
        self.add(Layer {
            name,
            axes: &PREFIX,
            count: Count::Each,
            rows: self.key_value((D, V)),
            row_axes: &[V, D],
            last: (CN, self.matrices_of(CN, linear, 0)),
            is_gate: false,
            factors: vec![WeightedInput {
                input,
                columns: self.key_value((D2, V2)),
                first: 0,
                left: &[PC, S],
                summed: &[V2, D2],
                shared: true,
            }],
        })
    }

    /// Keys or values that queries see, `[N, H, P, D, S]`: those of the action tokens, then those of the prefix.
    fn attended(&mut self, own: Committed, cached: Committed, crossed: Option<Committed>) -> usize {
        let dims = self.source.statement.spec.dims;
        let sizes = self.builder.sizes.clone();
        let (heads, group) = (dims.heads as usize, dims.group());
        let tokens = sizes.count(T);
        let b = &mut self.builder;
        let head = b.map(H, |head| (head < heads).then_some(head / group));
        let token = b.map(P, |place| (place < tokens).then_some(place));
        let prefix = sizes.count(PC);
        let before = b.map(P, |place| place.checked_sub(tokens).filter(|p| *p < prefix));
        let of_itself = b.map(N, |n| sizes.kind(n).and_then(of_kind(SN)));
        let layer = |n| {
            sizes
                .kind(n)
                .and_then(of_kind(SN))
                .map(|_| sizes.layer(n).1)
        };
        let layer = b.map(N, layer);
        let rest = [Mapped(H, head), Of(D), Of(S)];
        let view = |first: [Index; 2]| [&first[..], &rest].concat();
        let mut views = vec![
            (own.tensor, view([Mapped(P, token), Mapped(N, of_itself)])),
            (cached.tensor, view([Mapped(P, before), Mapped(N, layer)])),
        ];
        if let Some(crossed) = crossed {
            let cross = b.map(N, |n| sizes.kind(n).and_then(of_kind(CN)));
            views.push((crossed.tensor, view([Mapped(P, before), Mapped(N, cross)])));
        }
        b.views(views)
    }

    /// Both halves of each head, rotated.
    fn rotated(
        &mut self,
        name: &'static str,
        axes: &[Axis; 5],
        plain: Committed,
        [cosine, sine]: [usize; 2],
    ) -> Committed {
        let head_dim = self.source.statement.spec.dims.head_dim as usize;
        let b: &mut Builder = &mut self.builder;
        let swapped = |d: usize| (d < head_dim).then_some((d + head_dim / 2) % head_dim);
        let swapped = b.map(D, swapped);
        let indices = axes.map(|axis| match axis {
            D => Mapped(D, swapped),
            other => Of(other),
        });
        let other = b.view(plain.tensor, &indices);
        let term = |view, public| {
            let factors = [Factor::Virtual(view), Factor::Public(public)];
            (1, factors.to_vec())
        };
        b.relations.monomials.push(Monomials {
            axes: axes.to_vec(),
            summed: 0,
            terms: vec![term(plain.view, cosine), term(other, sine)],
        });
        let sum = Atom::Monomials(b.relations.monomials.len() - 1);
        let value = vec![times(1, sum), times(1 << (TRIG_BITS - 1), Atom::One)];
        let shift = Along::Everywhere(TRIG_BITS as i64);
        let saturating = Saturating {
            models: axes[1],
            // A sum of two products of an int16 and up to 2^14
            bits: Along::Everywhere(17),
        };
        b.floor(name, axes, TOKENS, value, &shift, Some(saturating))
    }
}

/// The number of a layer of the kind that an axis is about.
fn of_kind(axis: Axis) -> impl Fn(Kind) -> Option<usize> {
    move |kind| match kind {
        Kind::OfItself(number) => (axis == SN).then_some(number),
        Kind::Cross(number) => (axis == CN).then_some(number),
    }
}
