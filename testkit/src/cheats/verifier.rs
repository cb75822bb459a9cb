//! A cheat's other side: whether a verifier with the files accepts the claim, and whether float64 confirms it.

use crate::claims::{name_weights, reference, ClaimingNode, FloatSample, Tensors};
use zk0_circuits::claim::private_input::Opening;
use zk0_circuits::claim::statement::check;
use zk0_circuits::claim::student::Confidence;
use zk0_circuits::model::draw::draw;
use zk0_circuits::{Claim, EvalSpec, Mode, PrivateInput, QuantisedWeights};

/// Runs the guest, and checks the claim against the files.
pub fn direct(input: &PrivateInput, files: [&QuantisedWeights; 2]) -> Result<Claim, String> {
    let read =
        PrivateInput::from_buffers(&input.to_buffers()).map_err(|error| error.to_string())?;
    let claim = check(&read).map_err(|error| error.to_string())?;
    names_files(&claim, files)?;
    Ok(claim)
}

/// Claims what `input` states, with the files' weights.
pub fn prove(mut input: PrivateInput) -> Result<Claim, String> {
    name_weights(&mut input);
    direct(&input, [&input.base, &input.update])
}

fn names_files(claim: &Claim, files: [&QuantisedWeights; 2]) -> Result<(), String> {
    let named = [claim.terms.base.quantised, claim.terms.update.quantised];
    if named != files.map(|file| file.digest(Mode::Direct)) {
        return Err("the claim names other weights than the files'".into());
    }
    Ok(())
}

/// The drawn samples, in order.
pub fn drawn(node: &ClaimingNode) -> Vec<FloatSample> {
    let openings = node.honest().input.openings;
    let index = |opening: Opening| opening.index as usize;
    let drawn = openings.into_iter().map(index);
    drawn.map(|index| node.data[index].clone()).collect()
}

/// Whether the update improves as claimed on these samples.
pub fn improves(node: &ClaimingNode, samples: &[FloatSample]) -> bool {
    let losses = [&node.base, &node.update].map(|tensors| losses(node, tensors, samples));
    share_of_quantile(node, &losses[0], &losses[1]) > 1.0
}

/// Student's t-statistic of the float64 differences, divided by the quantile at 95 %. Above 1, the test passes.
pub fn share_of_quantile(node: &ClaimingNode, before: &[f64], after: &[f64]) -> f64 {
    assert_eq!(node.test.confidence, Confidence::P95);
    let quantile = match before.len() {
        2 => 6.314,
        4 => 2.353,
        8 => 1.895,
        other => panic!("no quantile for {other} samples"),
    };
    let kept = 1.0 - node.test.min_improvement_bps as f64 / 10_000.0;
    let differences = before.iter().zip(after).map(|(b, u)| kept * b - u);
    let differences: Vec<f64> = differences.collect();
    let n = differences.len() as f64;
    let mean = differences.iter().sum::<f64>() / n;
    let variance = differences.iter().map(|d| (d - mean).powi(2)).sum::<f64>() / (n - 1.0);
    mean / (variance / n).sqrt() / quantile
}

/// The squared errors' sum in float64.
pub fn loss(node: &ClaimingNode, tensors: &Tensors, samples: &[FloatSample]) -> f64 {
    losses(node, tensors, samples).iter().sum()
}

/// Each sample's squared errors in float64.
pub fn losses(node: &ClaimingNode, tensors: &Tensors, samples: &[FloatSample]) -> Vec<f64> {
    let samples = samples.iter().enumerate();
    samples
        .map(|(position, parts)| loss_at(node, tensors, parts, position))
        .collect()
}

/// One sample's loss, with a position's noise and time.
pub fn loss_at(
    node: &ClaimingNode,
    tensors: &Tensors,
    parts: &FloatSample,
    position: usize,
) -> f64 {
    // The table's noise. The node's specification may round differently.
    let exact = EvalSpec {
        action: 12,
        ..EvalSpec::new(node.spec.dims)
    };
    let draw = draw(&exact, &node.challenge, position as u32, node.eval_samples);
    let noise: Vec<f64> = draw.noise.iter().map(|&n| n as f64 / 4096.0).collect();
    let time = draw.time as f64 / 65536.0;
    let (loss, _) = reference::loss(&node.spec.dims, tensors, parts, &noise, time);
    assert!(loss.is_finite(), "the float64 loss is {loss}");
    loss
}
