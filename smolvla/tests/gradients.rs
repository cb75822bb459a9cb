//! Gradients and AdamW steps against PyTorch's.
//!
//! The reference also trains `state_proj`, through the frozen language layers. So does this test (its optimiser and its
//! gradients take whatever variables they are given), which makes both runs comparable step by step, clipping included.

mod reference;

use std::collections::BTreeMap;

use candle_core::{Device, Tensor, Var};
use reference::{check, config, numbers, policy, relative_distance, text, Values};
use zk0_smolvla::layout::expert_layout;
use zk0_smolvla::model::expert::ExpertModel;
use zk0_smolvla::model::flow;
use zk0_smolvla::model::prefix::{CameraInput, PrefixInput, PrefixModel};
use zk0_smolvla::model::Parameters;
use zk0_smolvla::optimizer::{AdamW, AdamWOptions};
use zk0_smolvla::schedule::Schedule;
use zk0_smolvla::PolicyError;

struct Training {
    variables: BTreeMap<String, Var>,
    prefix: PrefixModel,
    expert: ExpertModel,
    inputs: Values,
    outputs: Values,
}

impl Training {
    fn new() -> Self {
        let (config, policy) = (config(), policy());
        let mut all = policy.frozen.clone();
        all.extend(policy.expert.into_tensors());
        let trainable = |name: &str| {
            expert_layout(&config).contains_key(name) || name.starts_with("model.state_proj.")
        };
        let mut variables = BTreeMap::new();
        let mut tensors = BTreeMap::new();
        for (name, t) in all {
            let tensor = Tensor::from_vec(t.data, t.shape, &Device::Cpu).unwrap();
            if trainable(&name) {
                let variable = Var::from_tensor(&tensor).unwrap();
                tensors.insert(name.clone(), variable.as_tensor().clone());
                variables.insert(name, variable);
            } else {
                tensors.insert(name, tensor);
            }
        }
        let parameters = Parameters::from_tensors(tensors);
        Self {
            variables,
            prefix: PrefixModel::new(&config, &parameters).unwrap(),
            expert: ExpertModel::new(&config, &parameters).unwrap(),
            inputs: Values::read("inputs.safetensors"),
            outputs: Values::read("outputs.safetensors"),
        }
    }

    fn losses(&self, noise: &str, time: &str) -> Tensor {
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
        let cache = self.prefix.cache(&input).unwrap();
        let (actions, noise) = (
            self.outputs.tensor("prepared.action"),
            self.inputs.tensor(noise),
        );
        let times = self.inputs.f32s(time);
        let x_t = flow::noisy_actions(&actions, &noise, &times).unwrap();
        let v_t = self.expert.forward(&cache, &x_t, &times).unwrap();
        flow::losses(&v_t, &flow::target_velocity(&actions, &noise).unwrap()).unwrap()
    }

    fn gradients_agree(&self, file: &str, loss: &Tensor) {
        let gradients = loss.backward().unwrap();
        let reference = Values::read(file);
        assert_eq!(self.variables.len(), reference.names().count());
        for (name, variable) in &self.variables {
            let found = gradients
                .get(variable)
                .unwrap_or_else(|| panic!("{name} has no gradient"));
            check(
                name,
                relative_distance(&numbers(found), reference.numbers(name)),
                2e-4,
            );
        }
    }

    /// Three steps; the largest and the share of large differences in how far the expert's entries moved.
    fn three_steps(&self, run: &str, clip_norm: f64, schedule: Schedule, steps: usize) {
        let json: serde_json::Value = serde_json::from_str(&text("optimizer.json")).unwrap();
        let expected = &json["runs"][run]["steps"];
        let start: BTreeMap<_, _> = self
            .variables
            .iter()
            .map(|(name, v)| (name.clone(), numbers(v.as_tensor())))
            .collect();
        let options = AdamWOptions {
            clip_norm,
            ..AdamWOptions::default()
        };
        let mut optimizer = AdamW::new(&self.variables, options).unwrap();
        for step in 0..3 {
            let losses = self.losses(
                &format!("train.{step}.noise"),
                &format!("train.{step}.time"),
            );
            let loss = flow::mean_loss(&losses).unwrap();
            let rate = schedule.learning_rate(1e-4, step, steps);
            let stepped = optimizer.step(&loss.backward().unwrap(), rate).unwrap();
            let norm = stepped.gradient_norm;
            let of = |what: &str| expected[step][what].as_f64().unwrap();
            check(
                &format!("step {step}: loss"),
                (numbers(&loss)[0] - of("loss")).abs(),
                1e-5,
            );
            check(
                &format!("step {step}: gradient norm"),
                (norm / of("grad_norm_before_clip") - 1.0).abs(),
                2e-4,
            );
            check(
                &format!("step {step}: learning rate"),
                (rate / of("lr") - 1.0).abs(),
                1e-9,
            );
        }
        let reference = Values::read(&format!("params_after_3_steps_{run}.safetensors"));
        let (mut worst, mut large, mut entries, mut moved) = (0.0f64, 0usize, 0usize, 0.0f64);
        for (name, variable) in &self.variables {
            let found = numbers(variable.as_tensor());
            for ((new, old), wanted) in found.iter().zip(&start[name]).zip(reference.numbers(name))
            {
                let difference = ((new - old) - (wanted - old)).abs();
                worst = worst.max(difference);
                large += usize::from(difference > 5e-6);
                moved += (wanted - old).abs();
                entries += 1;
            }
        }
        println!(
            "{entries} entries moved by {:.1e} on average",
            moved / entries as f64
        );
        assert!(moved / entries as f64 > 2e-5, "the reference moves");
        check("largest difference", worst, 6e-4);
        check(
            "share of differences above 5e-6",
            large as f64 / entries as f64,
            1e-3,
        );
    }
}

#[test]
fn gradients_of_the_valid_only_loss() {
    let training = Training::new();
    let is_pad = training.inputs.mask("batch.action_is_pad");
    let losses = training.losses("noise", "time");
    let loss = flow::mean_loss_valid_only(&losses, 6, &is_pad).unwrap();
    training.gradients_agree("grads_valid_only.safetensors", &loss);
}

#[test]
fn gradients_of_the_plain_loss() {
    let training = Training::new();
    let loss = flow::mean_loss(&training.losses("noise", "time")).unwrap();
    training.gradients_agree("grads.safetensors", &loss);
}

#[test]
fn three_adamw_steps() {
    Training::new().three_steps("constant_lr", 10.0, Schedule::Constant, 3);
}

#[test]
fn three_adamw_steps_with_schedule_and_acting_clip() {
    Training::new().three_steps("scheduled_clipped", 3.659, Schedule::LEROBOT, 60);
}

#[test]
fn schedule_is_lerobots() {
    let json: serde_json::Value = serde_json::from_str(&text("optimizer.json")).unwrap();
    for steps in [60, 30_000] {
        let expected = json["lr_at_step"][format!("num_training_steps={steps}")]
            .as_object()
            .unwrap();
        for (step, rate) in expected {
            let found = Schedule::LEROBOT.learning_rate(1e-4, step.parse().unwrap(), steps);
            assert!(
                (found / rate.as_f64().unwrap() - 1.0).abs() < 1e-9,
                "step {step} of {steps}: {found}, {rate}"
            );
        }
    }
}

#[test]
fn a_variable_that_the_loss_does_not_reach_is_an_error() {
    let lost = Var::zeros(3, candle_core::DType::F32, &Device::Cpu).unwrap();
    let used = Var::ones(3, candle_core::DType::F32, &Device::Cpu).unwrap();
    let variables = BTreeMap::from([
        ("lost".to_string(), lost),
        ("used".to_string(), used.clone()),
    ]);
    let mut optimizer = AdamW::new(&variables, AdamWOptions::default()).unwrap();
    let gradients = used.sqr().unwrap().sum_all().unwrap().backward().unwrap();
    let error = optimizer.step(&gradients, 1e-3).unwrap_err();
    assert!(
        matches!(&error, PolicyError::NoGradient(name) if name == "lost"),
        "{error}"
    );
}
