//! The whole evaluation, from the noised action to the loss.

use super::linear::{add_residual, gate, Layer, LayerSource, WeightedInput, Which};
use super::norm::Norm;
use crate::commitment::Parameters;
use crate::expert::builder::{bits_of, one, power_of_two, times, Builder, Saturating};
use crate::expert::publics::number;
use crate::expert::sample::{SampleTensors, ACTION_AXES, CACHE_AXES};
use crate::expert::sizes::*;
use crate::expert::statement::Statement;
use crate::expert::weights::{Flat, Matrices, Matrix};
use crate::relation::along::Along;
use crate::relation::Committed;
use crate::relation::Factor;
use crate::relation::{Atom, Axis, Count, Equality, Index, Instances, Monomials};
use alloc::vec;
use alloc::vec::Vec;
use zk0_circuits::model::arithmetic::tables::SIGMOID_BITS;
use zk0_circuits::model::layout::Layout;
use zk0_circuits::model::linear::{first_of_layer, place, Linear};
use zk0_circuits::model::spec::LayerScales;
use Index::{Mapped, Of};

const TOKENS: Count = Count::Masked(number::TOKENS);
/// The linear layer whose outputs are the time MLP's gate.
const TIME_MLP_IN: usize = 1;
/// Tensors before the first layer, and in each layer, as [`zk0_circuits::model::layout::expert_tensors`] lists them.
pub(super) const HEAD_TENSORS: usize = 6;
pub(super) const LAYER_TENSORS: usize = 9;

/// Tensors that the prover fills from elsewhere than other tensors.
#[derive(Clone, Copy, Debug)]
pub struct Given {
    /// The residual stream after each layer, `[T, N, F, S]`, which the relations define by itself.
    pub hidden: Committed,
    /// The velocity, `[T, M, A, S]`.
    pub velocity: Committed,
}

/// The expert, as relations.
pub struct Expert {
    /// What holds, and how the prover gets the values.
    pub builder: Builder,
    /// Where the weights lie.
    pub weights: Vec<Matrices>,
    /// The tensors of a sample.
    pub sample: SampleTensors,
    /// What the steps begin with.
    pub given: Given,
    /// The column of the table of powers.
    pub powers: Committed,
    /// The columns of the tables of gates, by fraction bits.
    pub gates: Vec<(u8, Committed)>,
    /// Values of each source, for one sample.
    pub used: [usize; 4],
    /// Bits of the number of such a value.
    pub source_bits: [u8; 4],
}

/// Bits of the number of a value of each source. What is committed to fills a column at least, with zeros after it.
fn source_bits(used: [usize; 4]) -> [u8; 4] {
    let [main, data, weights, tables] = used.map(bits_of);
    let column = Parameters::of_samples(data.into()).variables() as u8;
    [main.max(column), data.max(column), weights, tables]
}

/// Builds the expert.
pub(super) struct Building<'a> {
    pub builder: Builder,
    pub source: LayerSource<'a>,
    weights: Vec<Matrices>,
}

impl Expert {
    /// The relations of a statement, whose specification is valid.
    pub fn new(statement: &Statement) -> Self {
        let spec = &statement.spec;
        let sizes = Sizes::new(spec, statement.samples.len());
        let linears = zk0_circuits::model::linear::linears(spec);
        let layout = Layout::new(&spec.dims);
        let mut builder = Builder::new(sizes);
        builder.saturates = statement.saturates;
        builder.relations.instances = Some(Instances {
            axis: S,
            count: statement.samples.len(),
        });
        builder.relations.publics = crate::expert::publics::all(statement, &builder.sizes);
        let building = Building {
            builder,
            source: LayerSource {
                statement,
                linears: &linears,
                layout: &layout,
            },
            weights: vec![],
        };
        building.build()
    }
}

impl Building<'_> {
    fn build(mut self) -> Expert {
        let sample = SampleTensors::new(&mut self.builder);
        let SampleTensors {
            actions,
            keys,
            values,
        } = sample;
        for (tensor, axes, read) in [
            (actions, &ACTION_AXES[..], number::COUNTED),
            (keys, &CACHE_AXES, number::READ),
            (values, &CACHE_AXES, number::READ),
        ] {
            let name = self.builder.relations.tensors[tensor.tensor].name;
            let above = vec![one(tensor.atom()), times(1 << 15, Atom::One)];
            let bits = Along::Everywhere(16);
            self.builder.range(name, axes, Count::Each, above, &bits);
            self.zero_unless(tensor, axes, read);
        }
        let embedded = self.embed(actions);
        // The residual stream after all layers is committed to before its relation can be stated.
        let hidden = self.builder.commit("residual stream", &[T, N, F, S]);
        self.layers(embedded, hidden, keys, values);
        let velocity = self.velocity(hidden);
        self.loss(velocity, actions);
        let (powers, gates) = self.tables();
        let used = self.builder.place();
        Expert {
            builder: self.builder,
            weights: self.weights,
            sample,
            given: Given { hidden, velocity },
            powers,
            gates,
            used,
            source_bits: source_bits(used),
        }
    }

    /// Where the public tensor `read` is 0, a sample holds zero: otherwise one sample could be committed to in many ways.
    fn zero_unless(&mut self, tensor: Committed, axes: &[Axis], read: usize) {
        let r = &mut self.builder.relations;
        let factors = vec![Factor::Public(read), Factor::Virtual(tensor.view)];
        r.monomials.push(Monomials {
            axes: axes.to_vec(),
            summed: 0,
            terms: vec![(1, factors)],
        });
        let kept = Atom::Monomials(r.monomials.len() - 1);
        r.equalities.push(Equality {
            name: "what a sample holds where nothing is read",
            axes: axes.to_vec(),
            linear: vec![one(tensor.atom()), times(-1, kept)],
        });
    }

    pub fn scales(&self, n: usize) -> &LayerScales {
        let layers = &self.source.statement.spec.layers;
        let (_, layer) = self.builder.sizes.layer(n);
        &layers[layer.min(layers.len() - 1)]
    }

    /// A number for each layer of both models.
    fn per_layer(&self, f: impl Fn(&LayerScales) -> u8) -> Along {
        let all = 0..self.builder.sizes.count(N);
        Along::Axis(N, all.map(|n| f(self.scales(n)) as i64).collect())
    }

    /// For each index on [`N`], if there is such a layer, a matrix of one of its linear layers.
    pub fn matrices(&self, linear: usize, output: usize) -> Vec<Option<Which>> {
        let sizes = &self.builder.sizes;
        let all = (0..sizes.count(N)).map(|n| {
            let (model, layer) = sizes.layer(n);
            (layer < sizes.layers).then_some(Which {
                model,
                linear: first_of_layer(layer) + linear,
                output,
            })
        });
        all.collect()
    }

    /// A matrix of both models.
    pub fn both(linear: usize) -> (Axis, Vec<Option<Which>>) {
        let which = |model| {
            Some(Which {
                model,
                linear,
                output: 0,
            })
        };
        (M, vec![which(0), which(1)])
    }

    pub fn linear(&self, linear: usize) -> &Linear {
        &self.source.linears[linear]
    }

    pub fn add(&mut self, layer: Layer<'_>) -> Committed {
        let (out, weights) = layer.add(&mut self.builder, &self.source);
        self.weights.extend(weights);
        out
    }

    fn embed(&mut self, actions: Committed) -> Committed {
        let spec = &self.source.statement.spec;
        let (width, action) = (
            spec.dims.expert_width as usize,
            spec.dims.max_action_dim as usize,
        );
        let times_of_samples = self.source.statement.samples.iter();
        let mut time: Vec<i64> = times_of_samples.map(|s| s.draw.time as i64).collect();
        time.resize(self.builder.sizes.count(S), 0);
        let time = Along::Axis(S, time);
        let b = &mut self.builder;
        let noised = vec![
            b.scaled(&time.map(|time| (1 << 16) - time), 1, actions.atom()),
            b.scaled(&time, 1, Atom::Public(number::NOISE)),
            times(1 << 15, Atom::One),
        ];
        let sixteen = Along::Everywhere(16);
        let noised = b.floor("noised action", &[T, A, S], TOKENS, noised, &sixteen, None);
        let embedding = b.commit("time embedding", &[F2, S]);
        b.relations.equalities.push(Equality {
            name: "time embedding",
            axes: vec![F2, S],
            linear: vec![one(embedding.atom()), times(-1, Atom::Public(number::TIME))],
        });
        #[cfg(feature = "prove")]
        b.step(move |filling| {
            let values = filling.linear(&vec![one(Atom::Public(number::TIME))], &[F2, S]);
            filling.set(embedding, &[F2, S], &values);
        });
        let axes = [T, M, F, S];
        let layer = |name, linear, factors| Layer {
            name,
            axes: &axes,
            count: TOKENS,
            rows: Flat::one(F, width),
            row_axes: &[F],
            last: Self::both(linear),
            is_gate: linear == TIME_MLP_IN,
            factors,
        };
        let factor = |input, first, shared| WeightedInput {
            input,
            columns: Flat::one(F2, width),
            first,
            left: if shared { &[T, S] } else { &[S] },
            summed: &[F2],
            shared,
        };
        let input = vec![WeightedInput {
            input: noised.view,
            columns: Flat::one(A, action),
            first: 0,
            left: &[T, S],
            summed: &[A],
            shared: false,
        }];
        let embedded = self.add(layer("embedded action", 0, input));
        let summed = [Of(T), Of(M), Of(F2), Of(S)];
        let input = self.builder.view(embedded.tensor, &summed);
        let factors = vec![factor(input, 0, true), factor(embedding.view, width, false)];
        let mixed = self.add(layer("time MLP in", TIME_MLP_IN, factors));
        let spec = &self.source.statement.spec;
        let bits = Along::Everywhere(spec.time_hidden as i64);
        let shift = spec.time_hidden as i64 + SIGMOID_BITS as i64 - spec.time_activation as i64;
        let b = &mut self.builder;
        let wide = gate(b, "gate of the time MLP", &axes, mixed, &bits);
        let value = vec![one(wide.atom()), times(power_of_two(shift) >> 1, Atom::One)];
        let saturating = Saturating {
            models: M,
            bits: Along::Everywhere((31 - shift).max(0)),
        };
        let (name, shift) = ("SiLU of the time MLP", Along::Everywhere(shift));
        let activated = b.floor(name, &axes, TOKENS, value, &shift, Some(saturating));
        let input = b.view(activated.tensor, &summed);
        self.add(layer("time MLP out", 2, vec![factor(input, 0, true)]))
    }

    /// The gains of a norm: tensor `index` of each layer, or of the whole expert.
    pub fn gains(
        &mut self,
        name: &'static str,
        last: Axis,
        all: Vec<Option<(usize, usize)>>,
    ) -> (usize, Along) {
        let statement = self.source.statement;
        let width = statement.spec.dims.expert_width as usize;
        let bits = all.iter().map(|place| match place {
            Some((model, tensor)) => statement.scales[*model][*tensor] as i64,
            None => 0,
        });
        let bits = Along::Axis(last, bits.collect());
        let matrices = all.iter().map(|place| {
            place.map(|(model, tensor)| Matrix {
                model,
                tensor,
                stride: 1,
                first: 0,
            })
        });
        let shape = (Flat::none(), Flat::one(F, width));
        let matrices = matrices.collect();
        let (matrices, committed) = Matrices::add(&mut self.builder, name, shape, last, matrices);
        self.weights.push(matrices);
        (committed.view, bits)
    }

    /// A norm of the residual stream of all layers.
    fn norm(
        &mut self,
        name: &'static str,
        input: usize,
        index: usize,
        bits: Along,
        out: Along,
    ) -> Committed {
        let sizes = &self.builder.sizes;
        let gains = (0..sizes.count(N)).map(|n| {
            let (model, layer) = sizes.layer(n);
            (layer < sizes.layers).then_some((model, HEAD_TENSORS + layer * LAYER_TENSORS + index))
        });
        let gains = gains.collect();
        let (gain, gain_bits) = self.gains(name, N, gains);
        let norm = Norm {
            name,
            rows: &[T, N],
            input,
            gain,
            width: self.source.statement.spec.dims.expert_width as i64,
            shift: norm_shift(&gain_bits, &bits, &out),
            bits,
            count: TOKENS,
        };
        norm.relate(&mut self.builder)
    }

    fn layers(
        &mut self,
        embedded: Committed,
        hidden: Committed,
        keys: Committed,
        values: Committed,
    ) {
        let dims = self.source.statement.spec.dims;
        let width = dims.expert_width as usize;
        let query = Flat::two((D, dims.head_dim as usize), (H, dims.heads as usize));
        let sizes = self.builder.sizes.clone();
        let stream = [T, N, F, S];

        // What enters a layer is what its predecessor gave.
        let first = |n: usize| (sizes.layer(n).1 == 0).then_some(sizes.layer(n).0);
        let first = self.builder.map(N, first);
        let before = |n: usize| {
            let (model, layer) = sizes.layer(n);
            let before = layer.checked_sub(1).filter(|_| layer < sizes.layers);
            before.map(|before| sizes.n(model, before))
        };
        let before = self.builder.map(N, before);
        let input = self.builder.views(vec![
            (embedded.tensor, vec![Of(T), Mapped(N, first), Of(F), Of(S)]),
            (hidden.tensor, vec![Of(T), Mapped(N, before), Of(F), Of(S)]),
        ]);
        let spec = &self.source.statement.spec;
        let entering = |n: usize| match sizes.layer(n).1 {
            0 => spec.hidden,
            layer => spec.layers[(layer - 1).min(spec.layers.len() - 1)].hidden,
        };
        let all = 0..sizes.count(N);
        let bits = Along::Axis(N, all.map(|n| entering(n) as i64).collect());
        let out = self.per_layer(|scales| scales.normed);
        let normed = self.norm("input norm", input, 0, bits.clone(), out);

        let mut attention = self.projections(normed, keys, values, query.clone());
        attention.score_bits = self.per_layer(|scales| scales.query + scales.key);
        let attended = attention.relate(&mut self.builder);
        let out = self.add(Layer {
            name: "attention out",
            axes: &stream,
            count: TOKENS,
            rows: Flat::one(F, width),
            row_axes: &[F],
            last: (N, self.matrices(place::OUT, 0)),
            is_gate: false,
            factors: vec![WeightedInput {
                input: attended.view,
                columns: query,
                first: 0,
                left: &[T, S],
                summed: &[H, D],
                shared: true,
            }],
        });
        let attended_bits = self.per_layer(|scales| scales.attended);
        let scales = (&bits, &attended_bits);
        let b = &mut self.builder;
        let attended = b.commit("residual stream after attention", &stream);
        add_residual(b, attended, &stream, out, input, scales);
        let out = self.per_layer(|scales| scales.mlp_normed);
        let normed = self.norm("MLP norm", attended.view, 5, attended_bits.clone(), out);
        self.mlp(normed, attended, &attended_bits, hidden);
    }

    fn mlp(
        &mut self,
        normed: Committed,
        attended: Committed,
        attended_bits: &Along,
        hidden: Committed,
    ) {
        let dims = self.source.statement.spec.dims;
        let (width, mlp) = (dims.expert_width as usize, dims.expert_mlp as usize);
        let wide = [T, N, G, S];
        let mut halves = vec![];
        for (output, name) in ["gate", "up"].into_iter().enumerate() {
            let half = Layer {
                name,
                axes: &wide,
                count: TOKENS,
                rows: Flat::one(G, mlp),
                row_axes: &[G],
                last: (N, self.matrices(place::GATE_UP, output)),
                is_gate: output == 0,
                factors: vec![WeightedInput {
                    input: normed.view,
                    columns: Flat::one(F, width),
                    first: 0,
                    left: &[T, S],
                    summed: &[F],
                    shared: true,
                }],
            };
            halves.push(self.add(half));
        }
        let bits = self.per_layer(|scales| scales.gate);
        let b = &mut self.builder;
        let gate = gate(b, "gate times logistic", &wide, halves[0], &bits);
        b.relations.monomials.push(Monomials {
            axes: wide.to_vec(),
            summed: 0,
            terms: vec![(1, [gate.view, halves[1].view].map(Factor::Virtual).to_vec())],
        });
        let product = Atom::Monomials(b.relations.monomials.len() - 1);
        let shift = self.per_layer(|s| s.gate + s.up + SIGMOID_BITS as u8 - s.gated);
        let b = &mut self.builder;
        let half = shift.map(|shift| power_of_two(shift) >> 1);
        let value = vec![one(product), b.scaled(&half, 1, Atom::One)];
        let saturating = Saturating {
            models: N,
            bits: shift.map(|shift| (46 - shift).max(0)),
        };
        let gated = b.floor("gated MLP", &wide, TOKENS, value, &shift, Some(saturating));
        let stream = [T, N, F, S];
        let out = self.add(Layer {
            name: "down",
            axes: &stream,
            count: TOKENS,
            rows: Flat::one(F, width),
            row_axes: &[F],
            last: (N, self.matrices(place::DOWN, 0)),
            is_gate: false,
            factors: vec![WeightedInput {
                input: gated.view,
                columns: Flat::one(G, mlp),
                first: 0,
                left: &[T, S],
                summed: &[G],
                shared: true,
            }],
        });
        let bits = self.per_layer(|scales| scales.hidden);
        let scales = (attended_bits, &bits);
        let b = &mut self.builder;
        add_residual(b, hidden, &stream, out, attended.view, scales);
    }
}

/// From a norm's products to its results.
pub(super) fn norm_shift(gain: &Along, bits: &Along, out: &Along) -> Along {
    let (Along::Axis(axis, gain), Along::Axis(_, bits), Along::Axis(_, out)) = (gain, bits, out)
    else {
        unreachable!("scales differ along an axis");
    };
    let shifts = gain.iter().zip(bits).zip(out);
    let shifts = shifts.map(|((gain, bits), out)| gain + bits + 23 - out);
    Along::Axis(*axis, shifts.collect())
}
