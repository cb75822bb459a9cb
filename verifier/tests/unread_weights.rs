//! Attack 9 of the design: weights that nobody evaluates. The loss does not depend on them, but sampling does.

use crate::made::{
    self, draw, file, quantise, rounded, sample, tensors, terms, unread_of, Tensors, STRATEGIES,
    UNREAD,
};
use zk0_circuits::claim::public_values::CLAIM_VERSION;
use zk0_circuits::model::eval::{evaluate, Overflow};
use zk0_circuits::{
    Claim, DatasetCommitment, Digest, EvalSpec, Losses, Mode, NodeId, QuantisedWeights,
};
use zk0_protocol::{Refusal, RefusalCode, Rules};
use zk0_verifier::combine::bases::Bases;
use zk0_verifier::combine::contributions::WeightedContribution;
use zk0_verifier::combine::source::WeightsInMemory;
use zk0_verifier::{CheckedUpdate, Evaluation, WeightFiles};
use zk0_weights::Unread;

/// A claim about these files. Its proof would state nothing about weights that are not evaluated.
fn claim(files: &WeightFiles) -> Claim {
    let dataset = DatasetCommitment {
        root: Digest([3; 32]),
        samples: 1,
        feature_spec: Digest([3; 32]),
        salt_commitment: Digest([3; 32]),
    };
    let spec = EvalSpec::micro();
    Claim {
        version: CLAIM_VERSION,
        terms: terms(&spec, Mode::Direct, dataset, &files.base, &files.update),
        losses: Losses::Hidden,
        weight_check: None,
    }
}

/// What the verifier states to a claim about these weights, apart from its proof.
fn checked(base: &Tensors, update: &Tensors) -> Result<CheckedUpdate, Refusal> {
    let spec = EvalSpec::micro();
    let files = WeightFiles {
        base: file(&spec, base),
        update: file(&spec, update),
    };
    let evaluation = Evaluation::new(&spec, Mode::Direct).unwrap();
    evaluation.check_weights(&claim(&files), &[], &files, &Rules::default())
}

fn honest() -> (Tensors, Tensors) {
    let spec = EvalSpec::micro();
    let base = rounded(&spec, &tensors(&spec, 1, 4.0));
    let update = unread_of(&base, tensors(&spec, 2, 0.1));
    (base, update)
}

fn loss(update: &Tensors) -> f64 {
    let spec = EvalSpec::micro();
    let weights = quantise(&spec, update);
    let loss = evaluate(
        &spec,
        &weights,
        &sample(&spec),
        &draw(&spec),
        Overflow::Refused,
    )
    .unwrap();
    loss.squared_error as f64
}

#[test]
fn an_update_that_keeps_them_is_accepted_at_every_scale() {
    let (base, update) = honest();
    let accepted = checked(&base, &update).unwrap();
    assert_eq!(accepted.weights, quantise(&EvalSpec::micro(), &update));
    assert!(checked(&base, &base).is_ok());
    // The evaluated weights decide a coarser scale, at which the base's numbers are rounded.
    for growth in [3.0, 10.0, 100.0, 1000.0] {
        let mut grown = update.clone();
        for (name, from) in UNREAD {
            for value in &mut grown.get_mut(name).unwrap()[..from] {
                *value *= growth;
            }
        }
        assert!(checked(&base, &grown).is_ok(), "{growth}");
    }
}

/// The attack that was accepted: ±64 moves the loss by less than a thousandth, because only the rounding of the others changes.
#[test]
fn large_weights_where_nothing_is_evaluated_are_refused() {
    let (base, update) = honest();
    for (name, from) in UNREAD {
        let mut poisoned = update.clone();
        for (at, value) in poisoned.get_mut(name).unwrap()[from..]
            .iter_mut()
            .enumerate()
        {
            *value = if at % 2 == 0 { 64.0 } else { -64.0 };
        }
        let moved = (loss(&poisoned) - loss(&update)).abs() / loss(&update);
        assert!(moved < 0.01, "the loss moves by {moved}");
        match checked(&base, &poisoned) {
            Err(Refusal {
                code: RefusalCode::UnreadWeights { tensor, index, .. },
                detail,
            }) => {
                assert_eq!(index, from as u64);
                assert_eq!(detail, format!("tensor {tensor} is '{name}'"));
            }
            other => panic!("{other:?}"),
        }
    }
}

#[test]
fn any_other_number_is_refused_at_any_scale() {
    let (base, update) = honest();
    let spec = EvalSpec::micro();
    for (name, from) in UNREAD {
        let last = update[name].len() - 1;
        let largest = update[name]
            .iter()
            .fold(0f32, |most, one| most.max(one.abs()));
        // Where the weights are above 1/2 in magnitude, a step of the scale is 2^−15 or more.
        assert!(largest > 0.5);
        for change in [largest / 16_000.0, -largest / 16_000.0] {
            let mut changed = update.clone();
            changed.get_mut(name).unwrap()[last] += change;
            assert_ne!(quantise(&spec, &changed), quantise(&spec, &update));
            match checked(&base, &changed) {
                Err(Refusal {
                    code: RefusalCode::UnreadWeights { tensor, index, .. },
                    detail,
                }) => {
                    assert_eq!(index, last as u64);
                    assert_eq!(detail, format!("tensor {tensor} is '{name}'"));
                }
                other => panic!("{other:?}"),
            }
        }
        // Without them the scale is so fine that the base's numbers do not fit it.
        let mut zeros = update.clone();
        zeros.get_mut(name).unwrap()[from..].fill(0.0);
        let refused = checked(&base, &zeros).unwrap_err().to_string();
        assert!(refused.contains("has to stay as in the base"), "{refused}");
    }
}

#[test]
fn another_base_than_the_claim_names_is_refused() {
    let (base, update) = honest();
    let spec = EvalSpec::micro();
    let mut files = WeightFiles {
        base: file(&spec, &base),
        update: file(&spec, &update),
    };
    let claim = claim(&files);
    let evaluation = Evaluation::new(&spec, Mode::Direct).unwrap();
    files.base = file(&spec, &tensors(&spec, 9, 4.0));
    let refused = evaluation.check_weights(&claim, &[], &files, &Rules::default());
    assert!(
        matches!(
            refused,
            Err(Refusal {
                code: RefusalCode::UpdateDigest { .. },
                ..
            })
        ),
        "{refused:?}"
    );
}

/// Updates with coarser scales round the base's numbers, each in its own way. The result has the base's.
#[test]
fn a_result_keeps_the_base_s_numbers() {
    let spec = EvalSpec::micro();
    let format = made::format(&spec);
    let base = tensors(&spec, 1, 1.0);
    let base_file = file(&spec, &base);
    let unread = Unread::of(&format, &format.open(&base_file[..]).unwrap()).unwrap();
    let grown = |sign: f32, growth: f32| {
        let mut update = base.clone();
        for (name, from) in UNREAD {
            for value in &mut update.get_mut(name).unwrap()[..from] {
                *value *= sign * growth;
            }
        }
        quantise(&spec, &update)
    };
    // The two large ones cancel out, and Krum takes the first one.
    let updates: Vec<QuantisedWeights> = vec![grown(1.0, 1.0), grown(1.0, 30.0), grown(-1.0, 30.0)];
    let updates = updates.iter().map(|weights| WeightsInMemory {
        format: &format,
        weights,
    });
    let updates: Vec<_> = updates.collect();
    let given: Vec<_> = (0..)
        .zip(&updates)
        .map(|(node, weights)| WeightedContribution {
            node: NodeId([node; 32]),
            weight: 7,
            weights,
        })
        .collect();
    let start = quantise(&spec, &base);
    let bases = Bases {
        base: Some(start.clone()),
        earlier: Some(start.clone()),
    };
    for strategy in STRATEGIES {
        let result = made::combine(&format, &given, strategy, &bases, &unread).unwrap();
        let result = format.read(result.bytes()).unwrap();
        assert_eq!(unread.check(&format, &result), Ok(()));
        for stretch in format.unread() {
            let (before, scale) = format.tensor(&start, stretch.tensor);
            let (after, finer) = format.tensor(&result, stretch.tensor);
            assert!(finer >= scale, "nothing is rounded");
            let factor = 1i64 << (finer - scale);
            for (before, after) in before[stretch.from..].iter().zip(&after[stretch.from..]) {
                assert_eq!(i64::from(*before) * factor, i64::from(*after));
            }
        }
    }
}
