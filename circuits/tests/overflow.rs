//! A base that overflows cannot keep others from improving on it.

use zk0_circuits::claim::statement::check;
use zk0_circuits::claim::statement_error::StatementError;
use zk0_circuits::claim::terms::Model;
use zk0_circuits::model::elementwise::norm;
use zk0_circuits::model::eval::Evaluator;
use zk0_circuits::model::multiply::Multiply;
use zk0_circuits::model::site::{EvalError, Narrowing, Overflow, Site};
use zk0_circuits::{Claim, EvalSpec, Losses};
use zk0_testkit::claims::{quantise, tensors, ClaimingNode, Random, Tensors};

const NORM: &str = "model.vlm_with_expert.lm_expert.norm.weight";
const UP: &str = "model.vlm_with_expert.lm_expert.layers.1.mlp.up_proj.weight";

/// A claim with the base or the update changed.
fn claim(change: impl Fn(&mut ClaimingNode)) -> Result<Claim, StatementError> {
    let mut node = ClaimingNode::new(&EvalSpec::micro(), 20, 4, 11);
    change(&mut node);
    check(&node.honest().input)
}

fn scale(tensors: &mut Tensors, name: &str, factor: f32) {
    let values = tensors.get_mut(name).unwrap();
    values.iter_mut().for_each(|value| *value *= factor);
}

#[test]
fn an_overflowing_base_is_improved_on() {
    let claim = claim(|node| scale(&mut node.base, NORM, 1000.0)).unwrap();
    let Losses::Disclosed { before, after, .. } = claim.losses else {
        panic!("losses are hidden")
    };
    assert!(after < before);
}

#[test]
fn an_overflowing_update_improves_on_nothing() {
    let claim = claim(|node| {
        scale(&mut node.base, NORM, 1000.0);
        scale(&mut node.update, NORM, 1000.0);
    });
    assert!(matches!(
        claim,
        Err(StatementError::Eval {
            model: Model::Update,
            error: EvalError::OutOfRange {
                site: Site::FinalNorm,
                ..
            },
            ..
        })
    ));
}

#[test]
fn a_product_that_overflows_is_improved_on() {
    assert!(claim(|node| scale(&mut node.base, UP, 1000.0)).is_ok());
}

/// Sums of the smallest evaluation, with all weights as large as they can be.
#[test]
fn a_sum_of_a_base_that_does_not_fit_is_the_nearest_that_does() {
    let spec = EvalSpec::micro();
    let weights = quantise(&spec, &tensors(&spec, &mut Random(3), 1.0));
    let evaluator = Evaluator::new(&spec).unwrap();
    let linear = &evaluator.linears[0];
    let inputs = [[i16::MAX; 8], [i16::MIN; 8]].concat();
    let sums = |overflow| {
        let mut direct = evaluator.direct(&weights, overflow).unwrap();
        direct.linear(0, linear, &inputs)
    };
    let saturated = sums(Overflow::Saturated).unwrap();
    assert!(
        saturated.contains(&i32::MAX) && saturated.contains(&i32::MIN),
        "{saturated:?}"
    );
    let Err(EvalError::OutOfRange { site, value }) = sums(Overflow::Refused) else {
        panic!("it fits")
    };
    assert_eq!(site, Site::ActionIn);
    assert_ne!(value as i16 as i64, value);
}

/// The norm's results are those that fit, and the nearest ones in place of the others.
#[test]
fn a_value_of_a_base_that_does_not_fit_is_the_nearest_that_does() {
    let input = [1000, -1000, 10, 0];
    let gain = [i16::MAX, i16::MAX, i16::MAX, 1];
    let normed = |overflow, out| {
        let site = Site::FinalNorm;
        norm(Narrowing { site, overflow }, &input, 10, (&gain, 10), out)
    };
    let fits = normed(Overflow::Refused, 5).unwrap();
    assert_eq!(normed(Overflow::Saturated, 5), Ok(fits.clone()));
    assert!(fits
        .iter()
        .all(|&value| value.unsigned_abs() < i16::MAX.unsigned_abs()));
    let saturated = normed(Overflow::Saturated, 12).unwrap();
    assert_eq!(saturated[..2], [i16::MAX, i16::MIN]);
    assert!(saturated[2] > 0 && saturated[2] < i16::MAX);
    assert!(normed(Overflow::Refused, 12).is_err());
}
