//! Compares the fixed-point evaluation with LeRobot itself: velocity and loss of `tests/fixtures/smolvla_tiny`, evaluated from its
//! prefix cache.

use safetensors::tensor::TensorView;
use safetensors::SafeTensors;
use std::collections::HashMap;
use std::fs;
use std::path::PathBuf;
use zk0_circuits::model::draw::Draw;
use zk0_circuits::model::eval::{evaluate, Evaluator, Overflow};
use zk0_circuits::model::layout::expert_tensors;
use zk0_circuits::model::sample::{Sample, SampleParts};
use zk0_circuits::model::spec::{Dims, EvalSpec};
use zk0_circuits::model::weights::QuantisedWeights;

const TINY: Dims = Dims {
    expert_width: 54,
    expert_mlp: 256,
    heads: 6,
    kv_heads: 2,
    head_dim: 12,
    layers: 4,
    self_attn_every: 2,
    chunk: 10,
    max_action_dim: 32,
    action_dim: 6,
    max_prefix: 16,
};

fn fixture(name: &str) -> Vec<u8> {
    let path = PathBuf::from(env!("CARGO_MANIFEST_DIR"))
        .join("../tests/fixtures/smolvla_tiny")
        .join(name);
    fs::read(path).unwrap()
}

fn floats(view: &TensorView) -> Vec<f32> {
    view.data()
        .chunks_exact(4)
        .map(|b| f32::from_le_bytes(b.try_into().unwrap()))
        .collect()
}

#[test]
fn velocity_and_loss_agree_with_lerobot() {
    let (weights, inputs, outputs) = (
        fixture("weights.safetensors"),
        fixture("inputs.safetensors"),
        fixture("outputs.safetensors"),
    );
    let weights = SafeTensors::deserialize(&weights).unwrap();
    let inputs = SafeTensors::deserialize(&inputs).unwrap();
    let outputs = SafeTensors::deserialize(&outputs).unwrap();
    let spec = EvalSpec::new(TINY);
    let tensors: HashMap<String, Vec<f32>> = expert_tensors(&spec.dims)
        .into_iter()
        .map(|tensor| {
            let view = weights.tensor(&tensor.name).unwrap();
            assert_eq!(view.shape(), tensor.shape, "{}", tensor.name);
            (tensor.name, floats(&view))
        })
        .collect();
    let quantised =
        QuantisedWeights::quantise(&spec, |name| tensors.get(name).map(Vec::as_slice)).unwrap();

    let output = |name: &str| floats(&outputs.tensor(name).unwrap());
    let (mask, pad) = (
        outputs.tensor("prefix_pad_masks").unwrap().data().to_vec(),
        inputs
            .tensor("batch.action_is_pad")
            .unwrap()
            .data()
            .to_vec(),
    );
    let (noise, time) = (
        floats(&inputs.tensor("noise").unwrap()),
        floats(&inputs.tensor("time").unwrap()),
    );
    let (actions, expected_velocity) = (output("prepared.action"), output("v_t"));
    let expected_loss = output("per_sample_loss_valid_only");
    let (prefix, kv) = (16, spec.dims.kv_width());
    for sample in 0..2 {
        let cache: Vec<(Vec<f32>, Vec<f32>)> = (0..4)
            .map(|layer| {
                let valid = |what: &str| -> Vec<f32> {
                    let all = output(&format!("cache.{layer}.{what}"));
                    all[sample * prefix * kv..(sample + 1) * prefix * kv]
                        .chunks_exact(kv)
                        .zip(&mask[sample * prefix..])
                        .filter(|(_, &valid)| valid != 0)
                        .flat_map(|(token, _)| token.to_vec())
                        .collect()
                };
                (valid("key"), valid("value"))
            })
            .collect();
        let cache: Vec<(&[f32], &[f32])> = cache.iter().map(|(k, v)| (&k[..], &v[..])).collect();
        let is_pad: Vec<bool> = pad[sample * 10..(sample + 1) * 10]
            .iter()
            .map(|&p| p != 0)
            .collect();
        let row = sample * 320..(sample + 1) * 320;
        let parts = SampleParts {
            cache: &cache,
            actions: &actions[row.clone()],
            is_pad: &is_pad,
        };
        let fixed_sample = Sample::quantise(&spec, parts).unwrap();
        let scale = (1 << spec.action) as f32;
        let draw = Draw {
            time: (time[sample] * 65536.0).round() as u16,
            noise: noise[row.clone()]
                .iter()
                .map(|n| (n * scale).round() as i16)
                .collect(),
        };
        let evaluator = Evaluator::new(&spec).unwrap();
        let mut products = evaluator.direct(&quantised, Overflow::Refused).unwrap();
        let velocity = evaluator
            .velocity(&mut products, &fixed_sample, &draw)
            .unwrap();
        let mut worst = 0f32;
        for (frame, values) in velocity.chunks_exact(6).enumerate() {
            for (value, expected) in values
                .iter()
                .zip(&expected_velocity[row.start + frame * 32..])
            {
                worst = worst.max((*value as f32 / scale - expected).abs());
            }
        }
        let sum = evaluate(&spec, &quantised, &fixed_sample, &draw, Overflow::Refused).unwrap();
        let loss = sum.squared_error as f64 / (scale as f64).powi(2) / sum.elements as f64;
        // If the fixture states it, LeRobot's value is a mean that includes the padded action dimensions of the batch.
        let relative = (loss / expected_loss[sample] as f64 - 1.0).abs();
        println!("sample {sample}: v_t within {worst:.5}; loss {loss:.6}, LeRobot {:.6}: fidelity {relative:.2e}", expected_loss[sample]);
        assert!(worst < 0.02, "v_t off by {worst}");
        assert!(relative < 5e-3, "loss off by {relative}");
    }
}
