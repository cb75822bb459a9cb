//! Cheats with the evaluation specification: a node uses another, or the round's does not evaluate the policy.

use super::verifier::{direct, drawn, improves, loss, prove};
use crate::claims::{louder, nudged, ClaimingNode, Random};
use zk0_circuits::EvalSpec;

/// Claims updates without improvement under `spec`, until one is accepted. `prepare` changes data and weights.
fn tries(spec: &EvalSpec, prepare: impl Fn(&mut ClaimingNode)) -> Result<(), String> {
    spec.validate().map_err(|error| error.to_string())?;
    let mut node = ClaimingNode::new(spec, 12, 4, 16);
    prepare(&mut node);
    let drawn = drawn(&node);
    let before = loss(&node, &node.base, &drawn);
    let mut refused = Err("no update to try".to_string());
    for seed in 0..5000 {
        node.update = nudged(&node.base, &mut Random(seed), 0.1);
        if loss(&node, &node.update, &drawn) < 1.01 * before {
            continue;
        }
        assert!(!improves(&node, &drawn));
        refused = prove(node.honest().input).map(drop);
        if refused.is_ok() {
            break;
        }
    }
    refused
}

/// Reads the prefix's values as a quarter, the action tokens' own in full.
pub fn misread_cache() -> Result<(), String> {
    let mut spec = EvalSpec::micro();
    spec.layers[0].value = spec.layers[0].cache_value + 2;
    tries(&spec, |_| ())
}

/// Noise beyond two standard deviations changes its sign.
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

/// Under a time embedding independent of time, one of many bad updates looks better.
pub fn other_frequencies() -> Result<(), String> {
    let spec = EvalSpec::micro();
    let mut other = spec.clone();
    other.time_frequencies.fill(0);
    let mut node = ClaimingNode::new(&spec, 12, 4, 12);
    let drawn = drawn(&node);
    let before = loss(&node, &node.base, &drawn);
    for seed in 0..5000 {
        node.update = nudged(&node.base, &mut Random(seed), 0.3);
        if loss(&node, &node.update, &drawn) < 1.01 * before {
            continue;
        }
        let mut input = node.honest().input;
        input.header.spec = other.clone();
        match direct(&input, [&input.base, &input.update]) {
            Err(why) if why.contains("does not show") => {}
            Err(why) => return Err(why),
            Ok(claim) => {
                assert_eq!(claim.terms.evaluation, spec.digest());
                return Ok(());
            }
        }
    }
    Err("no update looks like an improvement".into())
}
