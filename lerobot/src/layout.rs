//! A policy's tensors: LeRobot's names, and shapes from the configuration.

use crate::config::{LayerKind, PolicyConfig, CHANNELS};

pub use zk0_tensors::TensorShapes;

/// The expert's layers.
pub const EXPERT: &str = "model.vlm_with_expert.lm_expert";
/// The frozen vision-language model.
pub const VLM: &str = "model.vlm_with_expert.vlm.model";
/// The projection of states into the prefix.
pub const STATE_PROJ: &str = "model.state_proj";
/// The language model's head: in the state dict, but unused by the policy.
pub const LM_HEAD: &str = "model.vlm_with_expert.vlm.lm_head.weight";

/// Tensors that training changes: the expert, its final norm, and action and time projections.
pub fn expert_layout(config: &PolicyConfig) -> TensorShapes {
    let mut layout = TensorShapes::new();
    let width = config.expert.width;
    for i in 0..config.text.layers {
        let kv_in = match config.layer_kind(i) {
            LayerKind::Joint => width,
            LayerKind::Cross => config.kv_width(),
        };
        decoder_layer(
            &mut layout,
            &format!("{EXPERT}.layers.{i}"),
            width,
            config.expert.mlp_width,
            kv_in,
            config,
        );
    }
    layout.insert(format!("{EXPERT}.norm.weight"), vec![width]);
    linear(
        &mut layout,
        "model.action_in_proj",
        width,
        config.max_action_dim,
    );
    linear(
        &mut layout,
        "model.action_out_proj",
        config.max_action_dim,
        width,
    );
    linear(&mut layout, "model.action_time_mlp_in", width, 2 * width);
    linear(&mut layout, "model.action_time_mlp_out", width, width);
    layout
}

/// Tensors that stay: vision tower, connector, language layers, state projection.
pub fn frozen_layout(config: &PolicyConfig) -> TensorShapes {
    let mut layout = TensorShapes::new();
    let (vision, text) = (&config.vision, &config.text);
    let tower = format!("{VLM}.vision_model");
    layout.insert(
        format!("{tower}.embeddings.patch_embedding.weight"),
        vec![vision.width, CHANNELS, vision.patch_size, vision.patch_size],
    );
    layout.insert(
        format!("{tower}.embeddings.patch_embedding.bias"),
        vec![vision.width],
    );
    layout.insert(
        format!("{tower}.embeddings.position_embedding.weight"),
        vec![config.patches(), vision.width],
    );
    for i in 0..vision.layers {
        let layer = format!("{tower}.encoder.layers.{i}");
        for projection in ["q_proj", "k_proj", "v_proj", "out_proj"] {
            linear(
                &mut layout,
                &format!("{layer}.self_attn.{projection}"),
                vision.width,
                vision.width,
            );
        }
        layer_norm(&mut layout, &format!("{layer}.layer_norm1"), vision.width);
        layer_norm(&mut layout, &format!("{layer}.layer_norm2"), vision.width);
        linear(
            &mut layout,
            &format!("{layer}.mlp.fc1"),
            vision.mlp_width,
            vision.width,
        );
        linear(
            &mut layout,
            &format!("{layer}.mlp.fc2"),
            vision.width,
            vision.mlp_width,
        );
    }
    layer_norm(
        &mut layout,
        &format!("{tower}.post_layernorm"),
        vision.width,
    );
    layout.insert(
        format!("{VLM}.connector.modality_projection.proj.weight"),
        vec![text.width, vision.width * vision.shuffle * vision.shuffle],
    );
    layout.insert(
        format!("{VLM}.text_model.embed_tokens.weight"),
        vec![text.vocabulary, text.width],
    );
    for i in 0..text.layers {
        let name = format!("{VLM}.text_model.layers.{i}");
        decoder_layer(
            &mut layout,
            &name,
            text.width,
            text.mlp_width,
            text.width,
            config,
        );
    }
    layout.insert(format!("{VLM}.text_model.norm.weight"), vec![text.width]);
    layout.extend(state_layout(config));
    layout
}

/// What training changes: the expert alone, so that a frame's prefix is computed once, or also the state projection, LeRobot's default
/// (`train_state_proj`), with a gradient through the frozen language layers.
pub fn trainable_layout(config: &PolicyConfig, train_state_proj: bool) -> TensorShapes {
    let mut layout = expert_layout(config);
    if train_state_proj {
        layout.extend(state_layout(config));
    }
    layout
}

/// All tensors of a state dict: the policy's and the language model's head.
pub fn state_dict_layout(config: &PolicyConfig) -> TensorShapes {
    let mut layout = policy_layout(config);
    let text = &config.text;
    layout.insert(LM_HEAD.into(), vec![text.vocabulary, text.width]);
    layout
}

fn state_layout(config: &PolicyConfig) -> TensorShapes {
    let mut layout = TensorShapes::new();
    linear(
        &mut layout,
        STATE_PROJ,
        config.text.width,
        config.max_state_dim,
    );
    layout
}

/// All of the policy's tensors.
pub fn policy_layout(config: &PolicyConfig) -> TensorShapes {
    let mut layout = frozen_layout(config);
    layout.extend(expert_layout(config));
    layout
}

fn linear(layout: &mut TensorShapes, name: &str, out: usize, input: usize) {
    layout.insert(format!("{name}.weight"), vec![out, input]);
    layout.insert(format!("{name}.bias"), vec![out]);
}

fn layer_norm(layout: &mut TensorShapes, name: &str, width: usize) {
    layout.insert(format!("{name}.weight"), vec![width]);
    layout.insert(format!("{name}.bias"), vec![width]);
}

/// A Llama layer without biases; key and value projections read `kv_in` values.
fn decoder_layer(
    layout: &mut TensorShapes,
    name: &str,
    width: usize,
    mlp_width: usize,
    kv_in: usize,
    config: &PolicyConfig,
) {
    let (q, kv) = (config.query_width(), config.kv_width());
    let matrices = [
        ("self_attn.q_proj", q, width),
        ("self_attn.k_proj", kv, kv_in),
        ("self_attn.v_proj", kv, kv_in),
        ("self_attn.o_proj", width, q),
        ("mlp.gate_proj", mlp_width, width),
        ("mlp.up_proj", mlp_width, width),
        ("mlp.down_proj", width, mlp_width),
    ];
    for (part, out, input) in matrices {
        layout.insert(format!("{name}.{part}.weight"), vec![out, input]);
    }
    for norm in ["input_layernorm", "post_attention_layernorm"] {
        layout.insert(format!("{name}.{norm}.weight"), vec![width]);
    }
}
