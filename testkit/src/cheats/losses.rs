//! Cheats with the right samples: other weights, no improvement, wrapped values.

use super::verifier::{direct, drawn, improves, loss, prove};
use crate::claims::{calmer, louder, nudged, quantise, ClaimingNode, Random, Tensors};
use zk0_circuits::{Digest, EvalSpec, PrivateInput};

const LAYERS: &str = "model.vlm_with_expert.lm_expert.layers";

fn node() -> ClaimingNode {
    ClaimingNode::new(&EvalSpec::micro(), 12, 8, 11)
}

fn prove_node(node: &ClaimingNode) -> Result<(), String> {
    assert!(!improves(node, &drawn(node)));
    prove(node.honest().input).map(drop)
}

/// Evaluates what `evaluate` puts in place of the named weights.
fn evaluate_others(
    node: &ClaimingNode,
    evaluate: impl Fn(&mut PrivateInput),
) -> Result<(), String> {
    assert!(!improves(node, &drawn(node)));
    let named = node.honest().input;
    let mut input = named.clone();
    evaluate(&mut input);
    direct(&input, [&named.base, &named.update]).map(drop)
}

/// Contributes the base, evaluates a calmer update.
pub fn other_update() -> Result<(), String> {
    let mut node = node();
    node.update = node.base.clone();
    let other = quantise(&node.spec, &calmer(&node.base));
    evaluate_others(&node, |input| input.update = other.clone())
}

/// Contributes the base, evaluates a louder base.
pub fn other_base() -> Result<(), String> {
    let mut node = node();
    node.update = node.base.clone();
    let other = quantise(&node.spec, &louder(&node.base, 2.0));
    evaluate_others(&node, |input| input.base = other.clone())
}

/// A higher loss.
pub fn worse() -> Result<(), String> {
    let mut node = node();
    node.update = louder(&node.base, 2.0);
    prove_node(&node)
}

/// The terms ask for improvement.
pub fn same() -> Result<(), String> {
    let mut node = node();
    node.update = node.base.clone();
    node.test.min_improvement_bps = 0;
    prove_node(&node)
}

/// Improves a little, claims nine tenths.
pub fn less() -> Result<(), String> {
    let mut node = node();
    node.test.min_improvement_bps = 9000;
    prove_node(&node)
}

/// By chance, the update looks better on the drawn samples; otherwise it is worse.
pub fn by_chance() -> Result<(), String> {
    let mut node = node();
    let samples = drawn(&node);
    let before = loss(&node, &node.base, &samples);
    let in_truth = |node: &ClaimingNode, tensors: &Tensors| -> f64 {
        let others = (0..20).map(|challenge| ClaimingNode {
            challenge: Digest([challenge; 32]),
            eval_samples: node.data.len() as u32,
            spec: node.spec.clone(),
            data: node.data.clone(),
            base: Tensors::new(),
            update: Tensors::new(),
            ..*node
        });
        others.map(|other| loss(&other, tensors, &other.data)).sum()
    };
    for seed in 0..1000 {
        node.update = nudged(&node.base, &mut Random(seed), 0.3);
        if loss(&node, &node.update, &samples) < 0.97 * before
            && !improves(&node, &samples)
            && in_truth(&node, &node.update) > in_truth(&node, &node.base)
        {
            return prove_node(&node);
        }
    }
    panic!("no update is better by chance");
}

fn scale(update: &mut Tensors, name: &str, factor: f32) {
    let values = update.get_mut(name).unwrap();
    values.iter_mut().for_each(|value| *value *= factor);
}

/// A hundredth of a 200 times larger final norm: twice the velocity. A wrapped norm gives nearly none.
pub fn wrapped_norm() -> Result<(), String> {
    let mut node = node();
    node.update = node.base.clone();
    scale(
        &mut node.update,
        "model.vlm_with_expert.lm_expert.norm.weight",
        200.0,
    );
    scale(&mut node.update, "model.action_out_proj.weight", 0.01);
    prove_node(&node)
}

/// The velocity is calmer, but 32 too high: an int16's full range.
pub fn wrapped_velocity() -> Result<(), String> {
    let mut node = node();
    let bias = node.update.get_mut("model.action_out_proj.bias").unwrap();
    bias.iter_mut().for_each(|bias| *bias += 32.0);
    prove_node(&node)
}

/// The update attends equally to six tokens with the largest values. Their weights round up to slightly more than 1, so the outputs wrap
/// to the other sign.
pub fn wrapped_outputs() -> Result<(), String> {
    let mut node = node();
    let width = node.spec.dims.kv_width();
    for parts in &mut node.data {
        for (keys, values) in &mut parts.cache {
            keys.truncate(6 * width);
            values.truncate(6 * width);
            values
                .chunks_exact_mut(width)
                .for_each(|token| token[0] = 1.0);
        }
    }
    tries(&mut node, "attention output: ", |node, random| {
        node.update = node.base.clone();
        scale(
            &mut node.update,
            &format!("{LAYERS}.1.self_attn.q_proj.weight"),
            0.0,
        );
        let values = node
            .update
            .get_mut(&format!("{LAYERS}.1.self_attn.v_proj.weight"));
        for row in values.unwrap().chunks_exact_mut(width) {
            row.fill(0.0);
            row[0] = 32767.0 / 1024.0;
        }
        let out = node
            .update
            .get_mut(&format!("{LAYERS}.1.self_attn.o_proj.weight"));
        out.unwrap()
            .iter_mut()
            .for_each(|value| *value = 0.02 * random.unit());
    })
}

/// Claims updates without improvement, until one is accepted, or refused because of `site`.
fn tries(
    node: &mut ClaimingNode,
    site: &str,
    update: impl Fn(&mut ClaimingNode, &mut Random),
) -> Result<(), String> {
    for seed in 0..5000 {
        update(node, &mut Random(seed));
        let drawn = drawn(node);
        if loss(node, &node.update, &drawn) < loss(node, &node.base, &drawn) {
            continue;
        }
        match prove_node(node) {
            Err(why) if !why.contains(site) => {}
            outcome => return outcome,
        }
    }
    Err("no update looks like an improvement".into())
}
