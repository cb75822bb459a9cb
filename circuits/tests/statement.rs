//! The statement refuses every cheat that one of its checks stops.

use zk0_circuits::claim::challenge::{challenge, sample_indices};
use zk0_circuits::claim::dataset::{check_leaves, salt_commitment, LeavesError};
use zk0_circuits::claim::private_input::{InputError, Opening};
use zk0_circuits::claim::statement::check;
use zk0_circuits::claim::statement_error::StatementError;
use zk0_circuits::claim::student::Confidence;
use zk0_circuits::claim::t_test::TTest;
use zk0_circuits::claim::terms::Model;
use zk0_circuits::model::site::{EvalError, Site};
use zk0_circuits::vm::merkle;
use zk0_circuits::{Digest, Disclosure, EvalSpec, Losses, Mode, NodeId, PrivateInput, Terms};
use zk0_testkit::claims::{calmer, honest, name_weights, quantise, tensors, Honest, Random};

fn micro() -> Honest {
    honest(&EvalSpec::micro(), 20, 4, 11)
}

fn refused(input: &PrivateInput) -> StatementError {
    check(input).expect_err("the cheat passes")
}

#[test]
fn an_honest_claim_holds_and_says_what_was_evaluated() {
    let honest = micro();
    let claim = check(&honest.input).unwrap();
    assert_eq!(claim.terms.evaluation, EvalSpec::micro().digest());
    assert_eq!(
        claim.terms.base.quantised,
        honest.input.base.digest(Mode::Direct)
    );
    assert_eq!(
        claim.terms.update.quantised,
        honest.input.update.digest(Mode::Direct)
    );
    assert_eq!(claim.terms.challenge, honest.input.header.terms.challenge);
    let Losses::Disclosed {
        before,
        after,
        elements,
    } = claim.losses
    else {
        panic!("losses are hidden")
    };
    assert!(after < before && elements > 0 && elements <= 4 * 6 * 6);
}

#[test]
fn hidden_losses_stay_hidden() {
    let mut honest = micro();
    honest.input.header.disclosure = Disclosure::Nothing;
    assert_eq!(check(&honest.input).unwrap().losses, Losses::Hidden);
}

#[test]
fn another_sample_than_the_drawn_one_is_refused() {
    let mut honest = micro();
    let drawn = honest.input.openings[0].index;
    let easy = (0..20)
        .find(|index| honest.input.openings.iter().all(|o| o.index != *index))
        .unwrap();
    // The prover opens a sample of the dataset honestly, but not the one that was drawn.
    honest.input.openings[0] = Opening {
        index: easy,
        sample: honest.dataset[easy as usize].clone(),
        path: merkle::path(&honest.leaves, easy as usize).unwrap(),
    };
    let expected = StatementError::Index {
        position: 0,
        found: easy,
        drawn,
    };
    assert_eq!(refused(&honest.input), expected);
    // The same sample under the drawn index is refused, too.
    honest.input.openings[0].index = drawn;
    assert_eq!(
        refused(&honest.input),
        StatementError::NotCommitted { index: drawn }
    );
    // The same sample with the path of the drawn sample is refused, too.
    honest.input.openings[0].path = merkle::path(&honest.leaves, drawn as usize).unwrap();
    assert_eq!(
        refused(&honest.input),
        StatementError::NotCommitted { index: drawn }
    );
}

#[test]
fn samples_in_another_order_are_refused() {
    let mut honest = micro();
    honest.input.openings.swap(1, 2);
    assert!(matches!(
        refused(&honest.input),
        StatementError::Index { position: 1, .. }
    ));
}

#[test]
fn one_sample_evaluated_twice_is_refused() {
    let mut honest = micro();
    honest.input.openings[1] = honest.input.openings[0].clone();
    assert!(matches!(
        refused(&honest.input),
        StatementError::Index { position: 1, .. }
    ));
}

#[test]
fn fewer_samples_than_claimed_are_refused() {
    let mut honest = micro();
    honest.input.openings.pop();
    let expected = StatementError::Openings {
        claimed: 4,
        opened: 3,
    };
    assert_eq!(refused(&honest.input), expected);
}

#[test]
fn a_wrong_path_is_refused() {
    for spoil in [
        |path: &mut Vec<Digest>| path[0].0[0] ^= 1,
        |path: &mut Vec<Digest>| path.truncate(2),
        |path: &mut Vec<Digest>| path.push(Digest([0; 32])),
    ] {
        let mut honest = micro();
        spoil(&mut honest.input.openings[2].path);
        let index = honest.input.openings[2].index;
        assert_eq!(
            refused(&honest.input),
            StatementError::NotCommitted { index }
        );
    }
}

#[test]
fn another_dataset_size_is_refused() {
    // Under a suitable challenge, both sizes give the same drawn indices. The shape of the tree differs.
    let mut honest = micro();
    let header = &mut honest.input.header;
    header.terms.dataset.samples = 21;
    let changed = (0..).map(|i| {
        challenge(
            &header.terms.network,
            i,
            &header.terms.node,
            &Digest([4; 32]),
            &Digest([5; 32]),
        )
    });
    let (challenge, indices) = changed
        .map(|challenge| (challenge, sample_indices(&challenge, 21, 1).unwrap()))
        .find(|(_, indices)| indices[0] == 19)
        .unwrap();
    header.terms.challenge = challenge;
    header.terms.eval_samples = 1;
    honest.input.openings = vec![Opening {
        index: indices[0],
        sample: honest.dataset[19].clone(),
        path: merkle::path(&honest.leaves, 19).unwrap(),
    }];
    assert_eq!(
        refused(&honest.input),
        StatementError::NotCommitted { index: 19 }
    );
}

#[test]
fn another_salt_is_refused() {
    let mut honest = micro();
    honest.input.header.salt[0] ^= 1;
    assert_eq!(refused(&honest.input), StatementError::Salt);
    // With the commitment of the other salt, the leaves differ.
    honest.input.header.terms.dataset.salt_commitment = salt_commitment(&honest.input.header.salt);
    assert!(matches!(
        refused(&honest.input),
        StatementError::NotCommitted { .. }
    ));
}

#[test]
fn swapped_weights_do_not_improve() {
    let mut honest = micro();
    std::mem::swap(&mut honest.input.base, &mut honest.input.update);
    name_weights(&mut honest.input);
    assert!(matches!(
        refused(&honest.input),
        StatementError::NoImprovement { .. }
    ));
}

#[test]
fn other_weights_give_another_digest() {
    let spec = EvalSpec::micro();
    let mut honest = micro();
    let claim = check(&honest.input).unwrap();
    let base = tensors(&spec, &mut Random(12), 1.0);
    (honest.input.base, honest.input.update) =
        (quantise(&spec, &base), quantise(&spec, &calmer(&base)));
    // The terms name the weights, so other weights are refused.
    let expected = StatementError::Weights(Model::Base);
    assert_eq!(refused(&honest.input), expected);
    name_weights(&mut honest.input);
    let other = check(&honest.input).unwrap();
    assert_ne!(claim.terms.base.quantised, other.terms.base.quantised);
    assert_ne!(claim.terms.update.quantised, other.terms.update.quantised);
}

#[test]
fn the_base_itself_is_no_improvement() {
    let mut honest = micro();
    honest.input.update = honest.input.base.clone();
    name_weights(&mut honest.input);
    for bps in [0, 100] {
        honest.input.header.terms.test.min_improvement_bps = bps;
        assert!(matches!(
            refused(&honest.input),
            StatementError::NoImprovement { .. }
        ));
    }
}

#[test]
fn too_small_an_improvement_is_refused() {
    let mut honest = micro();
    let Losses::Disclosed { before, after, .. } = check(&honest.input).unwrap().losses else {
        panic!("losses are hidden")
    };
    let mut at = |min_improvement_bps| {
        honest.input.header.terms.test.min_improvement_bps = min_improvement_bps;
        check(&honest.input)
    };
    // The largest improvement that the test shows is below the one on the drawn samples.
    let shown = (0..10_000).take_while(|bps| at(*bps).is_ok()).last();
    let shown = shown.expect("the test shows an improvement");
    let achieved = ((before - after) as u128 * 10_000 / before as u128) as u32;
    assert!(100 < shown && shown < achieved, "{shown} {achieved}");
    let refused = StatementError::NoImprovement {
        before,
        after,
        samples: 4,
        test: TTest {
            min_improvement_bps: shown + 1,
            confidence: Confidence::P95,
        },
    };
    assert_eq!(at(shown + 1), Err(refused));
    // Nobody can lower a loss by more than all of it.
    for bps in [10_000, 10_001, u32::MAX] {
        assert!(at(bps).is_err(), "{bps}");
    }
}

#[test]
fn more_confidence_takes_more_samples() {
    let at = |samples, confidence| {
        let mut honest = honest(&EvalSpec::micro(), 40, samples, 11);
        honest.input.header.terms.test.confidence = confidence;
        check(&honest.input)
    };
    assert!(at(4, Confidence::P95).is_ok());
    assert!(at(4, Confidence::P999).is_err());
    assert!(at(32, Confidence::P999).is_ok());
}

#[test]
fn samples_beyond_the_dataset_cannot_be_drawn() {
    let mut honest = micro();
    honest.input.header.terms.eval_samples = 0;
    honest.input.openings.clear();
    assert!(matches!(refused(&honest.input), StatementError::Draw(_)));
    let all = sample_indices(&Digest([3; 32]), 5, 5).unwrap();
    let mut sorted = all.clone();
    sorted.sort_unstable();
    assert_eq!(sorted, [0, 1, 2, 3, 4], "drawn indices are not distinct");
    assert!(sample_indices(&Digest([3; 32]), 5, 6).is_err());
}

#[test]
fn overflowing_weights_are_an_error_that_names_the_site() {
    let spec = EvalSpec::micro();
    let mut honest = micro();
    let mut loud = tensors(&spec, &mut Random(12), 1.0);
    for value in loud
        .get_mut("model.vlm_with_expert.lm_expert.layers.1.mlp.up_proj.weight")
        .unwrap()
    {
        *value *= 1000.0;
    }
    honest.input.update = quantise(&spec, &loud);
    let StatementError::Eval {
        model: Model::Update,
        error: EvalError::OutOfRange { site, value },
        ..
    } = refused(&honest.input)
    else {
        panic!("overflow is not reported")
    };
    assert_eq!(site, Site::Up(1));
    assert!(i16::try_from(value).is_err());
}

#[test]
fn duplicates_in_a_leaf_list_are_found() {
    let honest = micro();
    let commitment = honest.input.header.terms.dataset;
    assert_eq!(check_leaves(&commitment, &honest.leaves), Ok(()));
    let mut leaves = honest.leaves.clone();
    leaves[17] = leaves[3];
    let mut padded = commitment;
    padded.root = merkle::root(&leaves);
    assert_eq!(
        check_leaves(&padded, &leaves),
        Err(LeavesError::Duplicate {
            first: 3,
            second: 17
        })
    );
    let mut reordered = honest.leaves.clone();
    reordered.swap(0, 1);
    assert!(matches!(
        check_leaves(&commitment, &reordered),
        Err(LeavesError::Root { .. })
    ));
    let expected = LeavesError::Count {
        committed: 20,
        listed: 19,
    };
    assert_eq!(
        check_leaves(&commitment, &honest.leaves[..19]),
        Err(expected)
    );
}

#[test]
fn challenges_depend_on_everything_they_name() {
    let of = |network, round, node, commitment, randomness| {
        let [network, commitment, randomness] =
            [network, commitment, randomness].map(|byte| Digest([byte; 32]));
        challenge(
            &network,
            round,
            &NodeId([node; 32]),
            &commitment,
            &randomness,
        )
    };
    let base = of(1, 2, 3, 4, 5);
    let others = [
        of(0, 2, 3, 4, 5),
        of(1, 0, 3, 4, 5),
        of(1, 2, 0, 4, 5),
        of(1, 2, 3, 0, 5),
        of(1, 2, 3, 4, 0),
    ];
    assert!(others.iter().all(|other| *other != base));
}

#[test]
fn a_private_input_survives_its_encoding_and_truncation_is_refused() {
    let honest = micro();
    let buffers = honest.input.to_buffers();
    assert_eq!(PrivateInput::from_buffers(&buffers).unwrap(), honest.input);
    for buffer in 0..buffers.len() {
        for cut in [1, 2, 8, buffers[buffer].len()] {
            let mut short = buffers.clone();
            let keep = short[buffer].len() - cut;
            short[buffer].truncate(keep);
            assert!(
                PrivateInput::from_buffers(&short).is_err(),
                "buffer {buffer} without {cut} bytes"
            );
            let mut long = buffers.clone();
            long[buffer].extend(vec![0; cut]);
            assert!(
                PrivateInput::from_buffers(&long).is_err(),
                "buffer {buffer} with {cut} more bytes"
            );
        }
    }
    assert_eq!(
        PrivateInput::from_buffers(&buffers[..3]),
        Err(InputError::Buffers {
            found: 3,
            expected: 4
        })
    );
}

#[test]
fn another_specification_than_the_terms_name_is_refused() {
    let mut honest = micro();
    let claimed = honest.input.header.terms.evaluation;
    honest.input.header.spec.dims.action_dim -= 1;
    let given = honest.input.header.spec.digest();
    let expected = StatementError::Evaluation { claimed, given };
    assert_eq!(refused(&honest.input), expected);
}

#[test]
fn a_claim_is_compared_term_by_term() {
    let honest = micro();
    let claim = check(&honest.input).unwrap();
    let terms = claim.terms;
    assert_eq!(terms, honest.input.header.terms);
    assert_eq!(claim.check(&terms, Disclosure::Losses), Ok(()));
    type Change = fn(&mut Terms);
    let changes: [(&str, Change); 16] = [
        ("network", |terms| terms.network.0[0] ^= 1),
        ("round", |terms| terms.round += 1),
        ("node", |terms| terms.node.0[0] ^= 1),
        ("dataset.root", |terms| terms.dataset.root.0[0] ^= 1),
        ("dataset.samples", |terms| terms.dataset.samples += 1),
        ("dataset.feature_spec", |terms| {
            terms.dataset.feature_spec.0[0] ^= 1
        }),
        ("dataset.salt_commitment", |terms| {
            terms.dataset.salt_commitment.0[0] ^= 1
        }),
        ("evaluation", |terms| terms.evaluation.0[0] ^= 1),
        ("base.blob", |terms| terms.base.blob.0[0] ^= 1),
        ("base.quantised", |terms| terms.base.quantised.0[0] ^= 1),
        ("update.blob", |terms| terms.update.blob.0[0] ^= 1),
        ("update.quantised", |terms| terms.update.quantised.0[0] ^= 1),
        ("challenge", |terms| terms.challenge.0[0] ^= 1),
        ("eval_samples", |terms| terms.eval_samples += 1),
        ("test.min_improvement_bps", |terms| {
            terms.test.min_improvement_bps += 1
        }),
        ("test.confidence", |terms| {
            terms.test.confidence = Confidence::P99
        }),
    ];
    for (term, change) in changes {
        let mut expected = terms;
        change(&mut expected);
        let wrong = claim.check(&expected, Disclosure::Losses).unwrap_err();
        assert_eq!(wrong.term, term);
        assert_ne!(wrong.claimed, wrong.expected);
    }
    let wrong = claim.check(&terms, Disclosure::Nothing).unwrap_err();
    let text = "the claim's disclosure is losses; expected is nothing";
    assert_eq!(wrong.to_string(), text);
}
