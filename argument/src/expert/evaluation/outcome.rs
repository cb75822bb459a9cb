//! What comes of the residual stream: the velocity and the loss. And the tables that all of the evaluation looks things up in.

use super::layers::{norm_shift, Building, HEAD_TENSORS, LAYER_TENSORS};
use super::linear::{Layer, WeightedInput};
use super::norm::Norm;
use crate::expert::builder::{one, times, Tag, TABLES};
use crate::expert::publics::number;
use crate::expert::sizes::*;
use crate::expert::weights::Flat;
use crate::relation::along::Along;
use crate::relation::Factor;
use crate::relation::{Atom, Committed, Count, Equality, Index, Monomials};
use alloc::vec;
use alloc::vec::Vec;
use zk0_circuits::model::linear::first_of_layer;
use Index::{Mapped, Of};

const TOKENS: Count = Count::Masked(number::TOKENS);

impl Building<'_> {
    /// The velocity that follows from the residual stream of the last layer.
    pub fn velocity(&mut self, hidden: Committed) -> Committed {
        let spec = &self.source.statement.spec;
        let (dims, final_normed) = (spec.dims, spec.final_normed);
        let layers = self.builder.sizes.layers;
        let sizes = self.builder.sizes.clone();
        let last = self
            .builder
            .map(M, |model| Some(sizes.n(model, layers - 1)));
        let view = [Of(T), Mapped(M, last), Of(F), Of(S)];
        let input = self.builder.view(hidden.tensor, &view);
        let gains = (0..2).map(|model| Some((model, HEAD_TENSORS + layers * LAYER_TENSORS)));
        let (gain, gain_bits) = self.gains("final norm", M, gains.collect());
        let entering = self.scales(sizes.n(0, layers - 1)).hidden as i64;
        let bits = Along::Axis(M, vec![entering; 2]);
        let out = Along::Axis(M, vec![final_normed as i64; 2]);
        let norm = Norm {
            name: "final norm",
            rows: &[T, M],
            input,
            gain,
            width: dims.expert_width as i64,
            shift: norm_shift(&gain_bits, &bits, &out),
            bits,
            count: TOKENS,
        };
        let normed = norm.relate(&mut self.builder);
        let linear = first_of_layer(layers);
        let rows = self.linear(linear).outputs[0].rows;
        self.add(Layer {
            name: "velocity",
            axes: &[T, M, A, S],
            count: TOKENS,
            rows: Flat::one(A, rows),
            row_axes: &[A],
            last: Self::both(linear),
            is_gate: false,
            factors: vec![WeightedInput {
                input: normed.view,
                columns: Flat::one(F, dims.expert_width as usize),
                first: 0,
                left: &[T, S],
                summed: &[F],
                shared: true,
            }],
        })
    }

    /// `Σ (velocity − noise + action)²` over what counts is the loss of each model on each sample.
    pub fn loss(&mut self, velocity: Committed, actions: Committed) {
        use Factor::{Public, Virtual};
        let (v, a, noise) = (
            Virtual(velocity.view),
            Virtual(actions.view),
            Public(number::NOISE),
        );
        let counted = Public(number::COUNTED);
        let terms = [
            (1, v, v),
            (1, a, a),
            (1, noise, noise),
            (2, v, a),
            (-2, v, noise),
            (-2, a, noise),
        ];
        let terms = terms.map(|(factor, x, y)| (factor, vec![counted, x, y]));
        let r = &mut self.builder.relations;
        r.monomials.push(Monomials {
            axes: vec![M, S, T, A],
            summed: 2,
            terms: terms.to_vec(),
        });
        let loss = Atom::Monomials(r.monomials.len() - 1);
        r.equalities.push(Equality {
            name: "the loss",
            axes: vec![M, S],
            linear: vec![one(loss), times(-1, Atom::Public(number::LOSSES))],
        });
    }

    /// The tables: the columns of the powers, and of the gates by their fraction bits.
    pub fn tables(&mut self) -> (Committed, Vec<(u8, Committed)>) {
        let b = &mut self.builder;
        b.offer_ranges(number::RANGE_VALUE, number::RANGE_BITS);
        let powers = b.tensor("powers of two", TABLES, &[X]);
        let row = vec![one(Atom::Public(number::DISTANCE))];
        let columns = [row, vec![one(powers.atom())], vec![one(Atom::One)]];
        b.offer("powers of two", &[X], columns, Tag::Power);
        b.offer(
            "what is not seen",
            &[],
            [vec![], vec![], vec![]],
            Tag::Power,
        );
        let spec = &self.source.statement.spec;
        let mut bits: Vec<u8> = spec.layers.iter().map(|scales| scales.gate).collect();
        bits.push(spec.time_hidden);
        bits.sort_unstable();
        bits.dedup();
        let b = &mut self.builder;
        let mut gates = vec![];
        for bits in bits {
            let column = b.tensor("gates", TABLES, &[Q]);
            let row = vec![one(Atom::Public(number::GATE))];
            b.offer(
                "gates",
                &[Q],
                [row, vec![one(column.atom())], vec![]],
                Tag::Gate(bits),
            );
            gates.push((bits, column));
        }
        (powers, gates)
    }
}
