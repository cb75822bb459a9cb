//! The action expert in float64, from the paper's and LeRobot's definitions, not the fixed-point code.

use super::{FloatSample, Tensors};
use zk0_circuits::model::spec::Dims;

type FloatMatrix = Vec<Vec<f64>>;

struct ReferenceExpert<'a> {
    dims: &'a Dims,
    tensors: &'a Tensors,
}

/// Velocity `[chunk][max_action_dim]` for noise `[chunk, max_action_dim]` at flow time `time`.
pub fn velocity(
    dims: &Dims,
    tensors: &Tensors,
    parts: &FloatSample,
    noise: &[f64],
    time: f64,
) -> FloatMatrix {
    let expert = ReferenceExpert { dims, tensors };
    let width = dims.max_action_dim as usize;
    let noised: FloatMatrix = noise
        .chunks(width)
        .zip(parts.actions.chunks(width))
        .map(|(noise, action)| {
            noise
                .iter()
                .zip(action)
                .map(|(n, a)| time * n + (1.0 - time) * *a as f64)
                .collect()
        })
        .collect();
    let half = dims.expert_width as usize / 2;
    let angle = |i: usize| {
        let fraction = i as f64 / (half - 1).max(1) as f64;
        std::f64::consts::TAU * time / (0.004 * 1000f64.powf(fraction))
    };
    let embedding: Vec<f64> = (0..half)
        .map(|i| angle(i).sin())
        .chain((0..half).map(|i| angle(i).cos()))
        .collect();
    let embedded = expert.linear("model.action_in_proj", &noised);
    let joined: FloatMatrix = embedded
        .iter()
        .map(|row| row.iter().chain(&embedding).copied().collect())
        .collect();
    let mixed = expert.linear("model.action_time_mlp_in", &joined);
    let active: FloatMatrix = mixed
        .iter()
        .map(|row| row.iter().map(|&x| silu(x)).collect())
        .collect();
    let mut hidden = expert.linear("model.action_time_mlp_out", &active);
    for layer in 0..dims.layers as usize {
        hidden = expert.layer(layer, &hidden, &parts.cache[layer]);
    }
    expert.linear(
        "model.action_out_proj",
        &expert.norm("model.vlm_with_expert.lm_expert.norm", &hidden),
    )
}

/// Sum of squared errors and elements, over unpadded frames and real dimensions.
pub fn loss(
    dims: &Dims,
    tensors: &Tensors,
    parts: &FloatSample,
    noise: &[f64],
    time: f64,
) -> (f64, u64) {
    let velocity = velocity(dims, tensors, parts, noise, time);
    let (mut sum, mut elements) = (0.0, 0);
    for (frame, row) in velocity
        .iter()
        .enumerate()
        .filter(|(frame, _)| !parts.is_pad[*frame])
    {
        for (dim, v) in row.iter().enumerate().take(dims.action_dim as usize) {
            let at = frame * dims.max_action_dim as usize + dim;
            sum += (v - (noise[at] - parts.actions[at] as f64)).powi(2);
            elements += 1;
        }
    }
    (sum, elements)
}

fn silu(x: f64) -> f64 {
    x / (1.0 + (-x).exp())
}

fn rows(flat: &[f32], width: usize) -> FloatMatrix {
    flat.chunks(width)
        .map(|row| row.iter().map(|&x| x as f64).collect())
        .collect()
}

fn add(a: &FloatMatrix, b: &FloatMatrix) -> FloatMatrix {
    a.iter()
        .zip(b)
        .map(|(a, b)| a.iter().zip(b).map(|(a, b)| a + b).collect())
        .collect()
}

impl ReferenceExpert<'_> {
    fn linear(&self, name: &str, input: &FloatMatrix) -> FloatMatrix {
        let width = input[0].len();
        let weight = rows(&self.tensors[&format!("{name}.weight")], width);
        let bias = self.tensors.get(&format!("{name}.bias"));
        let output = |row: &Vec<f64>, index: usize| -> f64 {
            let dot: f64 = row.iter().zip(&weight[index]).map(|(x, w)| x * w).sum();
            dot + bias.map_or(0.0, |bias| bias[index] as f64)
        };
        input
            .iter()
            .map(|row| (0..weight.len()).map(|index| output(row, index)).collect())
            .collect()
    }

    fn norm(&self, name: &str, input: &FloatMatrix) -> FloatMatrix {
        let gain = &self.tensors[&format!("{name}.weight")];
        let one = |row: &Vec<f64>| {
            let mean = row.iter().map(|x| x * x).sum::<f64>() / row.len() as f64;
            row.iter()
                .zip(gain)
                .map(|(x, &g)| x * g as f64 / (mean + 1e-5).sqrt())
                .collect()
        };
        input.iter().map(one).collect()
    }

    fn layer(
        &self,
        layer: usize,
        hidden: &FloatMatrix,
        cache: &(Vec<f32>, Vec<f32>),
    ) -> FloatMatrix {
        let name = |part: &str| format!("model.vlm_with_expert.lm_expert.layers.{layer}.{part}");
        let kv_width = (self.dims.kv_heads * self.dims.head_dim) as usize;
        let (mut keys, mut values) = (rows(&cache.0, kv_width), rows(&cache.1, kv_width));
        let prefix = keys.len();
        let normed = self.norm(&name("input_layernorm"), hidden);
        let queries = self.linear(&name("self_attn.q_proj"), &normed);
        let own = layer.is_multiple_of(self.dims.self_attn_every as usize);
        let queries = self.rope(queries, if own { prefix } else { 0 });
        if own {
            keys.extend(self.rope(self.linear(&name("self_attn.k_proj"), &normed), prefix));
            values.extend(self.linear(&name("self_attn.v_proj"), &normed));
        } else {
            keys = self.linear(&name("self_attn.k_proj"), &keys);
            values = self.linear(&name("self_attn.v_proj"), &values);
        }
        let attention: FloatMatrix = queries
            .iter()
            .enumerate()
            .map(|(token, query)| {
                let visible = if own { prefix + token + 1 } else { prefix };
                self.attend(query, &keys[..visible], &values[..visible])
            })
            .collect();
        let hidden = add(hidden, &self.linear(&name("self_attn.o_proj"), &attention));
        let normed = self.norm(&name("post_attention_layernorm"), &hidden);
        let gate = self.linear(&name("mlp.gate_proj"), &normed);
        let up = self.linear(&name("mlp.up_proj"), &normed);
        let gated: FloatMatrix = gate
            .iter()
            .zip(&up)
            .map(|(gate, up)| gate.iter().zip(up).map(|(&g, u)| silu(g) * u).collect())
            .collect();
        add(&hidden, &self.linear(&name("mlp.down_proj"), &gated))
    }

    fn attend(&self, query: &[f64], keys: &[Vec<f64>], values: &[Vec<f64>]) -> Vec<f64> {
        let (head_dim, group) = (
            self.dims.head_dim as usize,
            (self.dims.heads / self.dims.kv_heads) as usize,
        );
        let mut output = Vec::new();
        for (head, query) in query.chunks(head_dim).enumerate() {
            let at = head / group * head_dim;
            let dots: Vec<f64> = keys
                .iter()
                .map(|key| query.iter().zip(&key[at..]).map(|(q, k)| q * k).sum())
                .collect();
            let largest = dots.iter().copied().fold(f64::MIN, f64::max);
            let scores: Vec<f64> = dots
                .iter()
                .map(|dot| ((dot - largest) / (head_dim as f64).sqrt()).exp())
                .collect();
            let total: f64 = scores.iter().sum();
            for dim in 0..head_dim {
                let sum: f64 = scores
                    .iter()
                    .zip(values)
                    .map(|(p, value)| p * value[at + dim])
                    .sum();
                output.push(sum / total);
            }
        }
        output
    }

    fn rope(&self, mut input: FloatMatrix, start: usize) -> FloatMatrix {
        let head_dim = self.dims.head_dim as usize;
        let half = head_dim / 2;
        for (index, row) in input.iter_mut().enumerate() {
            for head in row.chunks_mut(head_dim) {
                for i in 0..half {
                    let angle = (start + index) as f64 * 10000f64.powf(-(i as f64) / half as f64);
                    let (a, b) = (head[i], head[i + half]);
                    head[i] = a * angle.cos() - b * angle.sin();
                    head[i + half] = b * angle.cos() + a * angle.sin();
                }
            }
        }
        input
    }
}
