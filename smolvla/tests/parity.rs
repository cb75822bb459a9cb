//! The policy in candle against LeRobot's own values, within the tolerances of the fixture's README.

mod reference;

use candle_core::{Device, Tensor};
use reference::{check, close, close_where, config, distance, numbers, policy, text, Values};
use zk0_smolvla::action_error::{sample_actions, STEPS};
use zk0_smolvla::batch::Batch;
use zk0_smolvla::evaluate::{evaluate, FlowDraw};
use zk0_smolvla::image::resize_with_pad;
use zk0_smolvla::model::expert::ExpertModel;
use zk0_smolvla::model::flow;
use zk0_smolvla::model::prefix::{CameraInput, PrefixEmbedding, PrefixInput, PrefixModel};
use zk0_smolvla::model::rope::Rope;
use zk0_smolvla::model::time_embedding::time_embedding;
use zk0_smolvla::model::Parameters;
use zk0_smolvla::sample::PreparedSample;
use zk0_smolvla::Profile;

/// Before the transformer.
const EARLY: f64 = 5e-5;
/// Hidden states and velocities.
const HIDDEN: f64 = 1e-4;

struct Run {
    inputs: Values,
    outputs: Values,
    prefix: PrefixModel,
    expert: ExpertModel,
}

impl Run {
    fn new() -> Self {
        let (config, policy) = (config(), policy());
        let mut all = policy.frozen.clone();
        all.extend(policy.expert.into_tensors());
        let parameters = Parameters::load(&all, &Device::Cpu).unwrap();
        Self {
            inputs: Values::read("inputs.safetensors"),
            outputs: Values::read("outputs.safetensors"),
            prefix: PrefixModel::new(&config, &parameters).unwrap(),
            expert: ExpertModel::new(&config, &parameters).unwrap(),
        }
    }

    fn embedding(&self) -> PrefixEmbedding {
        let cameras = (0..2).map(|i| CameraInput {
            pixels: self.outputs.tensor(&format!("prepared.image.{i}")),
            present: self.outputs.flags(&format!("prepared.image_mask.{i}")),
        });
        let input = PrefixInput {
            cameras: cameras.collect(),
            tokens: self.inputs.ids("batch.observation.language.tokens"),
            token_mask: self
                .inputs
                .mask("batch.observation.language.attention_mask"),
            state: self.outputs.tensor("prepared.state"),
        };
        self.prefix.embed(&input).unwrap()
    }
}

#[test]
fn configuration_is_read_from_lerobots_files() {
    assert_eq!(config(), Profile::Tiny.config());
}

#[test]
fn images_are_resized_and_padded() {
    let units = Values::read("units.safetensors");
    let mut cases = 0;
    for name in units
        .names()
        .filter(|n| n.starts_with("resize_with_pad") && n.ends_with(".in"))
    {
        let out = name.replace(".in", ".out");
        let ([_, _, h, w], [_, _, oh, ow]) = (units.shape(name), units.shape(&out)) else {
            panic!("{name}")
        };
        let found = resize_with_pad(&units.f32s(name), (*h, *w), (*oh, *ow));
        let found: Vec<f64> = found.into_iter().map(f64::from).collect();
        check(&out, distance(&found, units.numbers(&out)), EARLY);
        cases += 1;
    }
    assert_eq!(cases, 5);

    let (inputs, outputs) = (
        Values::read("inputs.safetensors"),
        Values::read("outputs.safetensors"),
    );
    for camera in 0..2 {
        let name = format!("batch.observation.images.camera{}", camera + 1);
        let shape = inputs.shape(&name);
        let found = resize_with_pad(&inputs.f32s(&name), (shape[2], shape[3]), (64, 64));
        let found: Vec<f64> = found
            .into_iter()
            .map(|x| f64::from(2.0 * x - 1.0))
            .collect();
        let prepared = format!("prepared.image.{camera}");
        check(
            &prepared,
            distance(&found, outputs.numbers(&prepared)),
            EARLY,
        );
    }
}

#[test]
fn rotary_and_time_embeddings() {
    let units = Values::read("units.safetensors");
    let positions: Vec<Vec<i64>> = units
        .numbers("rope.positions")
        .chunks(5)
        .map(|row| row.iter().map(|p| *p as i64).collect())
        .collect();
    let rope = Rope::new(&positions, 12, &Device::Cpu).unwrap();
    close(
        &units,
        "rope.out",
        &rope.apply(&units.tensor("rope.in")).unwrap(),
        EARLY,
    );

    for width in [54, 720] {
        let found: Vec<f64> = units
            .f32s("time_emb.time")
            .iter()
            .flat_map(|t| time_embedding(*t, width, 0.004, 4.0))
            .collect();
        let name = format!("time_emb.{width}");
        check(&name, distance(&found, units.numbers(&name)), 1e-9);
    }
}

#[test]
fn prefix_from_pixels_to_cache() {
    let run = Run::new();
    let out = &run.outputs;
    let embedding = run.embedding();
    for (camera, vision) in embedding.vision.iter().enumerate() {
        for layer in 0..2 {
            close(
                out,
                &format!("vision.{camera}.layer.{layer}.input"),
                &vision.hidden[layer],
                EARLY,
            );
        }
        close(
            out,
            &format!("vision.{camera}.post_layernorm"),
            &vision.normed,
            EARLY,
        );
        close(
            out,
            &format!("vision.{camera}.connector"),
            &vision.tokens,
            EARLY,
        );
    }
    let valid = out.mask("prefix_pad_masks");
    assert_eq!(embedding.valid, valid);
    assert!(
        valid.iter().flatten().any(|v| !v),
        "the fixture has padding"
    );
    close(out, "prefix_embs", &embedding.tokens, EARLY);

    let prefix = run.prefix.run(&embedding).unwrap();
    for layer in 0..4 {
        close_where(
            out,
            &format!("train.vlm.layer.{layer}.input"),
            &prefix.hidden[layer],
            &valid,
            HIDDEN,
        );
        close_where(
            out,
            &format!("cache.{layer}.key"),
            &prefix.cache.keys[layer],
            &valid,
            HIDDEN,
        );
        close_where(
            out,
            &format!("cache.{layer}.value"),
            &prefix.cache.values[layer],
            &valid,
            HIDDEN,
        );
    }
    close_where(
        out,
        "train.vlm.final_norm.input",
        &prefix.hidden[4],
        &valid,
        HIDDEN,
    );
    close_where(out, "prefix_out", &prefix.output, &valid, HIDDEN);
}

#[test]
fn expert_and_losses() {
    let run = Run::new();
    let (inputs, out) = (&run.inputs, &run.outputs);
    let cache = run.prefix.run(&run.embedding()).unwrap().cache;
    let (actions, noise) = (out.tensor("prepared.action"), inputs.tensor("noise"));
    let times = inputs.f32s("time");
    let x_t = flow::noisy_actions(&actions, &noise, &times).unwrap();
    let u_t = flow::target_velocity(&actions, &noise).unwrap();
    close(out, "x_t", &x_t, EARLY);
    close(out, "u_t", &u_t, EARLY);
    close(
        out,
        "time_emb",
        &run.expert.embed_time(&times, &Device::Cpu).unwrap(),
        1e-6,
    );

    let suffix = run.expert.embed(&x_t, &times).unwrap();
    close(out, "suffix_embs", &suffix, EARLY);
    let hidden = run.expert.hidden_states(&cache, &suffix).unwrap();
    for (layer, input) in hidden.iter().enumerate().take(4) {
        close(
            out,
            &format!("train.expert.layer.{layer}.input"),
            input,
            HIDDEN,
        );
    }
    close(out, "train.expert.final_norm.input", &hidden[4], HIDDEN);
    close(
        out,
        "suffix_out",
        &run.expert.output(&hidden[4]).unwrap(),
        HIDDEN,
    );
    let v_t = run.expert.forward(&cache, &x_t, &times).unwrap();
    close(out, "v_t", &v_t, HIDDEN);

    let losses = flow::losses(&v_t, &u_t).unwrap();
    close(out, "losses", &losses, 5e-4);
    close(out, "loss", &flow::mean_loss(&losses).unwrap(), 1e-5);
    let is_pad = inputs.mask("batch.action_is_pad");
    assert!(
        is_pad.iter().flatten().any(|pad| *pad),
        "the fixture has padded frames"
    );
    close(
        out,
        "loss_valid_only",
        &flow::mean_loss_valid_only(&losses, 6, &is_pad).unwrap(),
        1e-5,
    );
    let each = flow::per_sample_loss_valid_only(&losses, 6, &is_pad).unwrap();
    close(out, "per_sample_loss_valid_only", &each, 1e-5);

    let facts: serde_json::Value = serde_json::from_str(&text("facts.json")).unwrap();
    let mean = numbers(&flow::mean_loss(&losses).unwrap())[0];
    check(
        "facts.json: loss",
        (mean - facts["loss"].as_f64().unwrap()).abs(),
        1e-5,
    );
}

/// A prepared sample leaves the padded prefix tokens out; its loss must be the reference's all the same.
#[test]
fn loss_from_samples_without_padding() {
    let run = Run::new();
    let (inputs, out) = (&run.inputs, &run.outputs);
    let cache = run.prefix.run(&run.embedding()).unwrap().cache;
    let is_pad = inputs.mask("batch.action_is_pad");
    let actions: Vec<Vec<f32>> = out
        .tensor("prepared.action")
        .flatten_from(1)
        .unwrap()
        .to_vec2()
        .unwrap();
    let noise: Vec<Vec<f32>> = inputs
        .tensor("noise")
        .flatten_from(1)
        .unwrap()
        .to_vec2()
        .unwrap();
    let pairs: Vec<(PreparedSample, FlowDraw)> = (0..2)
        .map(|b| {
            let valid = &cache.valid[b];
            let keep = |layers: &[Tensor]| -> Vec<Vec<f32>> {
                layers
                    .iter()
                    .map(|layer| {
                        let rows: Vec<Vec<f32>> = layer
                            .get(b)
                            .unwrap()
                            .flatten_from(1)
                            .unwrap()
                            .to_vec2()
                            .unwrap();
                        rows.into_iter()
                            .zip(valid)
                            .filter(|(_, v)| **v)
                            .flat_map(|(row, _)| row)
                            .collect()
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
            (
                sample,
                FlowDraw {
                    time: inputs.f32s("time")[b],
                    noise: noise[b].clone(),
                },
            )
        })
        .collect();
    let pairs: Vec<_> = pairs.iter().map(|(sample, draw)| (sample, draw)).collect();
    let weights = policy().expert;
    let loss = evaluate(&config(), &weights, &pairs).unwrap().loss();
    check(
        "loss_valid_only",
        (loss - out.numbers("loss_valid_only")[0]).abs(),
        1e-5,
    );
    for (b, pair) in pairs.iter().enumerate() {
        let loss = evaluate(&config(), &weights, &[*pair]).unwrap().loss();
        check(
            "per_sample_loss_valid_only",
            (loss - out.numbers("per_sample_loss_valid_only")[b]).abs(),
            1e-5,
        );
    }
}

/// Ten Euler steps of the velocity field from noise to actions.
#[test]
fn sampling() {
    let run = Run::new();
    let cache = run.prefix.run(&run.embedding()).unwrap().cache;
    let noise = run.inputs.tensor("sample_noise");
    let mut x = noise.clone();
    let velocities = run.outputs.tensor("sample.v_t");
    for step in 0..10 {
        let time = (1.0 + f64::from(step) * -0.1) as f32;
        let v = run.expert.forward(&cache, &x, &[time, time]).unwrap();
        let expected: Tensor = velocities.get(step as usize).unwrap();
        check(
            &format!("sample.v_t {step}"),
            distance(&numbers(&v), &numbers(&expected)),
            2e-4,
        );
        x = (x + (v * -0.1).unwrap()).unwrap();
    }
    close(&run.outputs, "sample.actions", &x, 2e-4);

    let rows: Vec<Vec<f32>> = noise.flatten_from(1).unwrap().to_vec2().unwrap();
    let draw = |noise| FlowDraw { time: 1.0, noise };
    let draws: Vec<FlowDraw> = rows.into_iter().map(draw).collect();
    let batch = Batch {
        cache,
        is_pad: vec![vec![false; x.dim(1).unwrap()]; draws.len()],
        actions: noise,
    };
    let sampled = sample_actions(&run.expert, &batch, &draws, STEPS).unwrap();
    close(&run.outputs, "sample.actions", &sampled, 2e-4);
}
