//! Phase one: images, language and state, to the key/value cache.

use candle_core::{Device, Tensor};
use zk0_lerobot::layout::VLM;
use zk0_smolvla::frames::cameras::camera_slots;
use zk0_smolvla::frames::image::resize_with_pad;
use zk0_smolvla::frames::sample::widen;
use zk0_smolvla::policy::model::layers::RmsNorm;
use zk0_smolvla::policy::model::visibility::{
    action_positions, action_sees, prefix_positions, prefix_sees,
};
use zk0_smolvla::policy::model::vision::VisionSite;
use zk0_smolvla::policy::model::PolicyParameters;

use super::case::{last_frames, Case, EARLY, HIDDEN};
use crate::reference::{close, close_numbers, close_where, is_committed, policy};

/// Returns the batch's images, in the policy's order and at its size, with blank ones for missing cameras.
#[test]
fn images_are_prepared_in_the_policys_order() {
    let case = Case::read();
    let (config, inputs, out) = (case.config(), &case.inputs, &case.outputs);
    let names: Vec<&str> = inputs
        .names()
        .filter_map(|name| name.strip_prefix("batch."))
        .filter(|name| config.camera_names.iter().any(|camera| camera == name))
        .collect();
    let empty = case.lerobot.empty_cameras;
    let slots = camera_slots(config, empty, &names).unwrap();
    assert_eq!(slots.len(), case.cameras());
    let size = config.vision.image_size;
    for (slot, source) in slots.into_iter().enumerate() {
        let prepared = format!("prepared.image.{slot}");
        let mask = out.flags(&format!("prepared.image_mask.{slot}"));
        let Some(source) = source else {
            let blank = vec![-1.0; out.numbers(&prepared).len()];
            close_numbers(out, &prepared, &blank, EARLY);
            assert_eq!(mask, vec![false; case.batch()]);
            continue;
        };
        let name = format!("batch.{}", names[source]);
        let shape = inputs.shape(&name);
        let (h, w) = (shape[shape.len() - 2], shape[shape.len() - 1]);
        let last = last_frames(&inputs.f32s(&name), 3 * h * w, case.batch());
        let mut found = resize_with_pad(&last, (h, w), (size, size));
        found.iter_mut().for_each(|x| *x = 2.0 * *x - 1.0);
        close_numbers(out, &prepared, &found, EARLY);
        let padding = format!("{name}_padding_mask");
        let expected = match inputs.contains(&padding) {
            true => inputs.flags(&padding),
            false => vec![true; case.batch()],
        };
        assert_eq!(mask, expected, "{prepared}");
    }
}

#[test]
fn states_and_actions_are_widened() {
    let case = Case::read();
    let (config, inputs, out) = (case.config(), &case.inputs, &case.outputs);
    let states = inputs.f32s("batch.observation.state");
    let last = last_frames(&states, config.state_dim, case.batch());
    let found = widen(&last, config.state_dim, config.max_state_dim);
    close_numbers(out, "prepared.state", &found, 0.0);
    let actions = inputs.f32s("batch.action");
    let found = widen(&actions, config.action_dim, config.max_action_dim);
    close_numbers(out, "prepared.action", &found, 0.0);
}

#[test]
pub fn vision_from_pixels_to_tokens() {
    let case = Case::read();
    let (config, out) = (case.config(), &case.outputs);
    let cameras = case.prefix_input().cameras;
    assert_eq!(cameras.len(), case.cameras());
    let side = config.vision.image_size / config.vision.patch_size;
    for (camera, input) in cameras.iter().enumerate() {
        let name = |what: &str| format!("vision.{camera}.{what}");
        let grid = (case.batch(), config.vision.width, side, side);
        let mut seen = 0;
        let mut observe = |site, values: &Tensor| {
            seen += 1;
            match site {
                VisionSite::Patches => {
                    let patches = values.transpose(1, 2).unwrap().reshape(grid).unwrap();
                    close(out, &name("patch_conv"), &patches, EARLY);
                }
                VisionSite::Hidden(layer) if layer == config.vision.layers => {}
                VisionSite::Hidden(layer) => {
                    close(out, &name(&format!("layer.{layer}.input")), values, EARLY)
                }
                VisionSite::Normed => close(out, &name("post_layernorm"), values, EARLY),
            }
        };
        let vision = case.prefix.vision();
        let tokens = vision.tokens(&input.pixels, &mut observe).unwrap();
        assert_eq!(seen, config.vision.layers + 3);
        close(out, &name("connector"), &tokens, EARLY);
    }
}

#[test]
pub fn prefix_embeddings_and_cache() {
    let case = Case::read();
    let (config, out) = (case.config(), &case.outputs);
    let embedding = case.embedding();
    let valid = out.mask("prefix_pad_masks");
    assert_eq!(embedding.valid, valid);
    if is_committed() {
        assert!(
            valid.iter().flatten().any(|v| !v),
            "the fixture has padding"
        );
    }
    close(out, "prefix_embs", &embedding.tokens, EARLY);

    let compare = |name: String, found: &Tensor| close_where(out, &name, found, &valid, HIDDEN);
    let mut hidden = vec![embedding.tokens.clone()];
    let mut observe = |attended: &Tensor, x: &Tensor| {
        let layer = hidden.len() - 1;
        compare(format!("train.vlm.layer.{layer}.attn_out"), attended);
        hidden.push(x.clone());
    };
    let cache = case.prefix.layers(&embedding, Some(&mut observe)).unwrap();
    assert_eq!(hidden.len(), config.text.layers + 1);
    for (layer, input) in hidden[..config.text.layers].iter().enumerate() {
        compare(format!("train.vlm.layer.{layer}.input"), input);
        compare(format!("cache.{layer}.key"), &cache.keys[layer]);
        compare(format!("cache.{layer}.value"), &cache.values[layer]);
    }
    let last = &hidden[config.text.layers];
    compare("train.vlm.final_norm.input".into(), last);
    // The policy has no use for the final norm, and so no part of it.
    let parameters = PolicyParameters::load(&policy().frozen, &Device::Cpu).unwrap();
    let name = format!("{VLM}.text_model.norm");
    let norm = RmsNorm::new(&parameters, &name, config.rms_norm_eps).unwrap();
    compare("prefix_out".into(), &norm.forward(last).unwrap());
}

/// Compares the positions and the visibility of prefix and action tokens together, as in LeRobot's training pass.
#[test]
fn position_ids_and_attention_masks() {
    let case = Case::read();
    let (out, chunk) = (&case.outputs, case.config().chunk_size);
    let embedding = case.embedding();
    let (mut positions, mut sees) = (Vec::new(), Vec::new());
    for valid in &embedding.valid {
        let prefix = valid.len();
        positions.extend(prefix_positions(valid));
        positions.extend(action_positions(valid, chunk));
        for query in 0..prefix + chunk {
            sees.extend(
                (0..prefix + chunk).map(|key| match query.checked_sub(prefix) {
                    Some(action) => action_sees(valid, action, key),
                    None => key < prefix && prefix_sees(valid, embedding.state, query, key),
                }),
            );
        }
    }
    let positions: Vec<f64> = positions.into_iter().map(|p| p as f64).collect();
    assert_eq!(positions, out.numbers("position_ids"));
    assert_eq!(sees, out.flags("att_2d_masks"));

    // A prefix token starts a group of its own if it is the state's token. An action token always does.
    let prefix = embedding.valid[0].len();
    let starts: Vec<bool> = (0..prefix).map(|token| token == embedding.state).collect();
    assert_eq!(starts.repeat(case.batch()), out.flags("prefix_att_masks"));
    let all = vec![true; case.batch() * chunk];
    assert_eq!(all, out.flags("suffix_att_masks"));
    assert_eq!(all, out.flags("suffix_pad_masks"));
}
