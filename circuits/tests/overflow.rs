//! A base that overflows cannot keep others from improving on it.

use zk0_circuits::claim::errors::{pairs, Errors};
use zk0_circuits::claim::statement::check;
use zk0_circuits::claim::statement_error::StatementError;
use zk0_circuits::claim::t_test::Pair;
use zk0_circuits::claim::terms::Model;
use zk0_circuits::model::arithmetic::products::Rows;
use zk0_circuits::model::eval::Evaluator;
use zk0_circuits::model::multiply::Multiply;
use zk0_circuits::model::site::{EvalError, Site};
use zk0_circuits::{Claim, EvalSpec, Losses};
use zk0_testkit::claims::{quantise, tensors, Node, Random, Tensors};

const NORM: &str = "model.vlm_with_expert.lm_expert.norm.weight";
const UP: &str = "model.vlm_with_expert.lm_expert.layers.1.mlp.up_proj.weight";

/// A claim with the base or the update changed.
fn claim(change: impl Fn(&mut Node)) -> Result<Claim, StatementError> {
    let mut node = Node::new(&EvalSpec::micro(), 20, 4, 11);
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
    // It overflows on all four samples.
    assert_eq!(before, 4 << 55);
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

#[test]
fn a_base_that_overflows_on_some_samples_counts_as_bad_as_on_its_worst() {
    let one = |base, update| Errors { base, update };
    let pair = |base, update| Pair { base, update };
    assert_eq!(
        pairs(&[one(Some(9), 5), one(None, 7), one(Some(3), 4)]),
        [pair(9, 5), pair(11, 7), pair(3, 4)]
    );
    // Where the base is nowhere worse than the update, it counts as the same.
    assert_eq!(
        pairs(&[one(Some(4), 5), one(None, 7)]),
        [pair(4, 5), pair(7, 7)]
    );
    assert_eq!(
        pairs(&[one(None, 5), one(None, 7)]),
        [pair(1 << 55, 5), pair(1 << 55, 7)]
    );
    assert_eq!(pairs(&[]), []);
}

#[test]
fn only_scores_that_a_token_sees_have_to_fit() {
    let spec = EvalSpec::micro();
    let weights = quantise(&spec, &tensors(&spec, &mut Random(3), 1.0));
    let evaluator = Evaluator::new(&spec).unwrap();
    let mut direct = evaluator.direct(&weights).unwrap();
    let site = Site::Scores(0);
    // The score of the first query and the second key is 2^31.
    let queries = [[1 << 14; 8], [0; 8]].concat();
    let keys = [[1; 8], [1 << 14; 8]].concat();
    let (queries, keys) = (Rows::new(&queries, 8), Rows::new(&keys, 8));
    let scores = direct
        .scores(site, queries, keys, |query| query + 1)
        .unwrap();
    assert_eq!((scores[0], scores[3]), (1 << 17, 0));
    let refused = direct.scores(site, queries, keys, |_| 2).unwrap_err();
    let value = 1 << 31;
    assert_eq!(refused, EvalError::OutOfRange { site, value });
}
