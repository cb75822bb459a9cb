//! Cheats with the evaluation specification: a node takes another than the round's, or whoever opens the round chooses one
//! under which the evaluation is not that of the policy.

use super::verifier::{direct, improves, loss, prove};
use crate::claims::{louder, nudged, Node, Parts, Random};
use zk0_circuits::EvalSpec;

/// Claims of updates that are no improvement, until one is accepted under `spec`. `prepare` changes a node's data and weights.
fn tries(spec: &EvalSpec, prepare: impl Fn(&mut Node)) -> Result<(), String> {
    spec.validate().map_err(|error| error.to_string())?;
    let mut node = Node::new(spec, 3, 1, 11);
    prepare(&mut node);
    let drawn = node.honest().input.openings[0].index as usize;
    let drawn: Parts = node.data[drawn].clone();
    let before = loss(&node, &node.base, &[&drawn]);
    let mut refused = Err("no update to try".to_string());
    for seed in 0..100 {
        node.update = nudged(&node.base, &mut Random(seed), 0.1);
        if loss(&node, &node.update, &[&drawn]) < 1.01 * before {
            continue;
        }
        assert!(!improves(&node, &[&drawn]));
        refused = prove(node.honest().input).map(drop);
        if refused.is_ok() {
            break;
        }
    }
    refused
}

/// The evaluation reads the values of the prefix as a quarter of what they are, and the action tokens' own values as they are.
pub fn misread_cache() -> Result<(), String> {
    let mut spec = EvalSpec::micro();
    spec.layers[0].value = spec.layers[0].cache_value + 2;
    tries(&spec, |_| ())
}

/// Noise beyond two standard deviations has the opposite sign.
pub fn wrapped_noise() -> Result<(), String> {
    let mut spec = EvalSpec::micro();
    spec.action = 14;
    tries(&spec, |node| {
        node.base = louder(&node.base, 0.3);
        for parts in &mut node.data {
            parts.actions.iter_mut().for_each(|action| *action *= 0.3);
        }
    })
}

/// The node evaluates with one action dimension, where the round's specification has six. The update is calmer in that one, and
/// louder in the others.
pub fn fewer_dimensions() -> Result<(), String> {
    let spec = EvalSpec::micro();
    let mut node = Node::new(&spec, 3, 1, 11);
    let mut update = louder(&node.base, 2.0);
    let width = spec.dims.expert_width as usize;
    for (name, first) in [("weight", width), ("bias", 1)] {
        let name = format!("model.action_out_proj.{name}");
        let base = &node.base[&name][..first];
        let values = update.get_mut(&name).unwrap();
        values[..first].copy_from_slice(base);
        values[..first].iter_mut().for_each(|value| *value *= 0.25);
    }
    node.update = update;
    let mut input = node.honest().input;
    let drawn = &node.data[input.openings[0].index as usize];
    assert!(!improves(&node, &[drawn]));
    input.header.spec.dims.action_dim = 1;
    let claim = direct(&input, [&input.base, &input.update])?;
    assert_eq!(claim.terms.evaluation, spec.digest());
    Ok(())
}
