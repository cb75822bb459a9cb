//! Phase two: noisy actions and a time, to the velocity and the losses.

use candle_core::{Device, Tensor};
use zk0_smolvla::frames::sample::PreparedSample;
use zk0_smolvla::measure::evaluate::{evaluate, FlowDraw};
use zk0_smolvla::policy::model::flow;
use zk0_smolvla::policy::model::observe::Site;

use super::case::{Case, EARLY, HIDDEN, LOSS, LOSSES};
use crate::reference::{check, close, is_committed, json, numbers, policy};

#[test]
pub fn expert_from_noise_to_velocity() {
    let case = Case::read();
    let (inputs, out, layers) = (&case.inputs, &case.outputs, case.config().text.layers);
    let (actions, noise) = (out.tensor("prepared.action"), inputs.tensor("noise"));
    let times = inputs.f32s("time");
    let x_t = flow::noisy_actions(&actions, &noise, &times).unwrap();
    close(out, "x_t", &x_t, EARLY);
    let u_t = flow::target_velocity(&actions, &noise).unwrap();
    close(out, "u_t", &u_t, EARLY);
    let time_emb = case.expert.embed_time(&times, &Device::Cpu).unwrap();
    close(out, "time_emb", &time_emb, 1e-6);

    let mut attended = 0;
    let v_t = case
        .expert
        .forward_observed(&case.cache(), &x_t, &times, &mut |site, values| {
            match site {
                Site::TimeMlpOut => {
                    close(out, "suffix_embs", values, EARLY);
                    close(out, "train.expert.layer.0.input", values, HIDDEN);
                }
                Site::MlpOut(layer) if layer + 1 == layers => {
                    close(out, "train.expert.final_norm.input", values, HIDDEN);
                }
                Site::MlpOut(layer) => {
                    let name = format!("train.expert.layer.{}.input", layer + 1);
                    close(out, &name, values, HIDDEN);
                }
                Site::Attention(layer) => {
                    let name = format!("train.expert.layer.{layer}.attn_out");
                    close(out, &name, values, HIDDEN);
                    attended += 1;
                }
                Site::FinalNorm => close(out, "suffix_out", values, HIDDEN),
                _ => {}
            }
            Ok(())
        })
        .unwrap();
    assert_eq!(attended, layers);
    close(out, "v_t", &v_t, HIDDEN);
}

#[test]
pub fn losses_under_both_rules() {
    let case = Case::read();
    let (inputs, out, config) = (&case.inputs, &case.outputs, case.config());
    let (actions, noise) = (out.tensor("prepared.action"), inputs.tensor("noise"));
    let times = inputs.f32s("time");
    let x_t = flow::noisy_actions(&actions, &noise, &times).unwrap();
    let v_t = case.expert.forward(&case.cache(), &x_t, &times).unwrap();
    let u_t = flow::target_velocity(&actions, &noise).unwrap();
    let losses = flow::losses(&v_t, &u_t).unwrap();
    close(out, "losses", &losses, LOSSES);
    let mean = flow::mean_loss(&losses).unwrap();
    close(out, "loss", &mean, LOSS);
    let each = losses.flatten_from(1).unwrap().mean(1).unwrap();
    close(out, "per_sample_loss", &each, LOSS);

    let is_pad = inputs.mask("batch.action_is_pad");
    if is_committed() {
        assert!(
            is_pad.iter().flatten().any(|pad| *pad),
            "the fixture has padded frames"
        );
    }
    let valid = flow::mean_loss_valid_only(&losses, config.action_dim, &is_pad).unwrap();
    close(out, "loss_valid_only", &valid, LOSS);
    let each = (0..case.batch()).map(|b| {
        let losses = losses.narrow(0, b, 1).unwrap();
        let is_pad = &is_pad[b..=b];
        flow::mean_loss_valid_only(&losses, config.action_dim, is_pad).unwrap()
    });
    let each = Tensor::stack(&each.collect::<Vec<_>>(), 0).unwrap();
    close(out, "per_sample_loss_valid_only", &each, LOSS);

    let facts = json("facts.json");
    for (name, loss) in [("loss", mean), ("loss_valid_only", valid)] {
        let known = facts[name].as_f64().unwrap();
        let name = format!("facts.json: {name}");
        check(&name, (numbers(&loss)[0] - known).abs(), LOSS);
    }
}

/// A prepared sample leaves the padded prefix tokens out; its loss must be the reference's all the same.
#[test]
pub fn loss_from_samples_without_padding() {
    let case = Case::read();
    let (inputs, out) = (&case.inputs, &case.outputs);
    let cache = case.cache();
    let is_pad = inputs.mask("batch.action_is_pad");
    let rows =
        |tensor: Tensor| -> Vec<Vec<f32>> { tensor.flatten_from(1).unwrap().to_vec2().unwrap() };
    let actions = rows(out.tensor("prepared.action"));
    let noise = rows(inputs.tensor("noise"));
    let pairs: Vec<(PreparedSample, FlowDraw)> = (0..case.batch())
        .map(|b| {
            let valid = &cache.valid[b];
            let keep = |layers: &[Tensor]| -> Vec<Vec<f32>> {
                layers
                    .iter()
                    .map(|layer| {
                        let tokens = rows(layer.get(b).unwrap());
                        let kept = tokens.into_iter().zip(valid).filter(|(_, v)| **v);
                        kept.flat_map(|(row, _)| row).collect()
                    })
                    .collect()
            };
            let sample = PreparedSample {
                prefix_tokens: valid.iter().filter(|v| **v).count(),
                keys: keep(&cache.keys),
                values: keep(&cache.values),
                actions: actions[b].clone(),
                is_pad: is_pad[b].clone(),
            };
            let draw = FlowDraw {
                time: inputs.f32s("time")[b],
                noise: noise[b].clone(),
            };
            (sample, draw)
        })
        .collect();
    let pairs: Vec<_> = pairs.iter().map(|(sample, draw)| (sample, draw)).collect();
    let weights = policy().expert;
    let loss = evaluate(case.config(), &weights, &pairs).unwrap().loss();
    let expected = out.numbers("loss_valid_only")[0];
    check("loss_valid_only", (loss - expected).abs(), LOSS);
    for (b, pair) in pairs.iter().enumerate() {
        let loss = evaluate(case.config(), &weights, &[*pair]).unwrap().loss();
        let expected = out.numbers("per_sample_loss_valid_only")[b];
        check("per_sample_loss_valid_only", (loss - expected).abs(), LOSS);
    }
}
