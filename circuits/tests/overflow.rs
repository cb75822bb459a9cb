//! A base that overflows cannot keep others from improving on it.

mod claims;

use claims::{quantise, Honest, Node, Tensors};
use zk0_circuits::claim::errors::{pairs, Errors};
use zk0_circuits::claim::hinted_input::HintedInput;
use zk0_circuits::claim::statement::{check, check_hinted};
use zk0_circuits::claim::statement_error::StatementError;
use zk0_circuits::claim::t_test::Pair;
use zk0_circuits::claim::terms::Model;
use zk0_circuits::model::site::{EvalError, Site};
use zk0_circuits::{Claim, EvalSpec, Losses, Mode};

const NORM: &str = "model.vlm_with_expert.lm_expert.norm.weight";
const UP: &str = "model.vlm_with_expert.lm_expert.layers.1.mlp.up_proj.weight";

/// A claim with the base or the update changed, in both modes.
fn claims(change: impl Fn(&mut Node)) -> [Result<Claim, StatementError>; 2] {
    let mut node = Node::new(&EvalSpec::micro(), 20, 4, 11);
    change(&mut node);
    [Mode::Direct, Mode::Checked].map(|mode| {
        let Honest { mut input, .. } = node.honest();
        let terms = &mut input.header.terms;
        terms.base.quantised = quantise(&node.spec, &node.base).digest(mode);
        terms.update.quantised = quantise(&node.spec, &node.update).digest(mode);
        match mode {
            Mode::Direct => check(&input),
            _ => check_hinted(&HintedInput::of(&input)?),
        }
    })
}

fn scale(tensors: &mut Tensors, name: &str, factor: f32) {
    let values = tensors.get_mut(name).unwrap();
    values.iter_mut().for_each(|value| *value *= factor);
}

#[test]
fn an_overflowing_base_is_improved_on() {
    for claim in claims(|node| scale(&mut node.base, NORM, 1000.0)) {
        let claim = claim.unwrap();
        let Losses::Disclosed { before, after, .. } = claim.losses else {
            panic!("losses are hidden")
        };
        // It overflows on all four samples.
        assert_eq!(before, 4 << 55);
        assert!(after < before);
    }
}

#[test]
fn an_overflowing_update_improves_on_nothing() {
    for claim in claims(|node| {
        scale(&mut node.base, NORM, 1000.0);
        scale(&mut node.update, NORM, 1000.0);
    }) {
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
}

/// Hints are int32, so no hint shows a sum that does not fit. The documentation names this limit of mode `checked`.
#[test]
fn a_product_that_overflows_is_improved_on_in_mode_direct_alone() {
    let [direct, checked] = claims(|node| scale(&mut node.base, UP, 1000.0));
    assert!(direct.is_ok());
    assert!(matches!(
        checked,
        Err(StatementError::Eval {
            model: Model::Base,
            error: EvalError::OutOfRange {
                site: Site::Up(1),
                ..
            },
            ..
        })
    ));
}

#[test]
fn no_overflow_of_the_base_can_be_made_up() {
    let node = Node::new(&EvalSpec::micro(), 20, 4, 11);
    let mut input = node.honest().input;
    input.header.terms.base.quantised = input.base.digest(Mode::Checked);
    input.header.terms.update.quantised = input.update.digest(Mode::Checked);
    let honest = HintedInput::of(&input).unwrap();
    let refused = |cheat: &mut HintedInput<'static>| {
        cheat.seal([&input.base, &input.update]).unwrap();
        match check_hinted(cheat).unwrap_err() {
            StatementError::Eval {
                model: Model::Base,
                error,
                ..
            } => error,
            other => panic!("{other}"),
        }
    };
    // The hints end in the middle of the evaluation, as they do where a value overflows.
    let mut cheat = honest.clone();
    let sums = cheat.base.hints[0].sums();
    cheat.base.hints[0] = zk0_circuits::freivalds::hints::Hints::new(&sums[..sums.len() / 2]);
    assert!(matches!(refused(&mut cheat), EvalError::Hints(_)));
    // Sums so large that what follows from them overflows.
    let mut cheat = honest.clone();
    cheat.base.hints[0]
        .sums_mut()
        .iter_mut()
        .for_each(|sum| *sum = i32::MAX);
    assert!(matches!(refused(&mut cheat), EvalError::Product(_)));
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
