//! Cheats by whoever opens a round, with a specification under which the evaluation is not that of the policy.

use super::verifier::{improves, loss, prove};
use crate::claims::{louder, nudged, Node, Parts, Random};
use zk0_circuits::EvalSpec;

/// Claims of updates that are no improvement, until one is accepted under `spec`. `prepare` changes a node's data and weights.
fn tries(spec: &EvalSpec, prepare: impl Fn(&mut Node)) -> Result<(), String> {
    spec.validate().map_err(|error| error.to_string())?;
    let mut node = Node::new(spec, 3, 1, 11);
    prepare(&mut node);
    let drawn = node.honest().witness.openings[0].index as usize;
    let drawn: Parts = node.data[drawn].clone();
    let before = loss(&node, &node.base, &[&drawn]);
    let mut refused = Err("no update to try".to_string());
    for seed in 0..100 {
        node.update = nudged(&node.base, &mut Random(seed), 0.1);
        if loss(&node, &node.update, &[&drawn]) < 1.01 * before {
            continue;
        }
        assert!(!improves(&node, &[&drawn]));
        refused = prove(node.honest().witness).map(drop);
        if refused.is_ok() {
            break;
        }
    }
    refused
}

/// Values of the prefix are read as a quarter of what they are, beside the action tokens' own.
pub fn misread_cache() -> Result<(), String> {
    let mut spec = EvalSpec::micro();
    spec.layers[0].value = spec.layers[0].cache_value + 2;
    tries(&spec, |_| ())
}

/// Noise beyond two standard deviations has the other sign.
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
