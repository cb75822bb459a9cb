//! Every check of the statement, and the cheat it stops.

mod claims;

use claims::{calmer, honest, name_weights, quantise, tensors, Honest, Random};
use zk0_circuits::{
    challenge::{challenge, sample_indices},
    dataset::{check_leaves, leaf, salt_commitment, LeavesError},
    eval::{evaluate, EvalError, Site},
    merkle,
    statement::{check, improves, Disclosure, Mode, Model, StatementError},
    witness::{Opening, WitnessError},
    Digest, EvalSpec, Losses, NodeId, Witness,
};

fn micro() -> Honest {
    honest(&EvalSpec::micro(), 20, 4, 11)
}

fn refused(witness: &Witness) -> StatementError {
    check(witness).expect_err("the cheat passes")
}

#[test]
fn an_honest_claim_holds_and_says_what_was_evaluated() {
    let honest = micro();
    let claim = check(&honest.witness).unwrap();
    assert_eq!(claim.evaluation, EvalSpec::micro().digest());
    assert_eq!(
        claim.base.quantised,
        honest.witness.base.digest(Mode::Direct)
    );
    assert_eq!(
        claim.update.quantised,
        honest.witness.update.digest(Mode::Direct)
    );
    assert_eq!(claim.challenge, honest.witness.header.challenge);
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
    honest.witness.header.disclosure = Disclosure::Hidden;
    assert_eq!(check(&honest.witness).unwrap().losses, Losses::Hidden);
}

#[test]
fn another_sample_than_the_drawn_one_is_refused() {
    let mut honest = micro();
    let drawn = honest.witness.openings[0].index;
    let easy = (0..20)
        .find(|index| honest.witness.openings.iter().all(|o| o.index != *index))
        .unwrap();
    // A sample of the dataset, honestly opened, but not the one that was drawn.
    honest.witness.openings[0] = Opening {
        index: easy,
        sample: honest.dataset[easy as usize].clone(),
        path: merkle::path(&honest.leaves, easy as usize).unwrap(),
    };
    let expected = StatementError::Index {
        position: 0,
        found: easy,
        drawn,
    };
    assert_eq!(refused(&honest.witness), expected);
    // Under the drawn index.
    honest.witness.openings[0].index = drawn;
    assert_eq!(
        refused(&honest.witness),
        StatementError::NotCommitted { index: drawn }
    );
    // With the drawn sample's path.
    honest.witness.openings[0].path = merkle::path(&honest.leaves, drawn as usize).unwrap();
    assert_eq!(
        refused(&honest.witness),
        StatementError::NotCommitted { index: drawn }
    );
}

#[test]
fn samples_in_another_order_are_refused() {
    let mut honest = micro();
    honest.witness.openings.swap(1, 2);
    assert!(matches!(
        refused(&honest.witness),
        StatementError::Index { position: 1, .. }
    ));
}

#[test]
fn one_sample_evaluated_twice_is_refused() {
    let mut honest = micro();
    honest.witness.openings[1] = honest.witness.openings[0].clone();
    assert!(matches!(
        refused(&honest.witness),
        StatementError::Index { position: 1, .. }
    ));
}

#[test]
fn fewer_samples_than_claimed_are_refused() {
    let mut honest = micro();
    honest.witness.openings.pop();
    let expected = StatementError::Openings {
        claimed: 4,
        opened: 3,
    };
    assert_eq!(refused(&honest.witness), expected);
}

#[test]
fn a_wrong_path_is_refused() {
    for spoil in [
        |path: &mut Vec<Digest>| path[0].0[0] ^= 1,
        |path: &mut Vec<Digest>| path.truncate(2),
        |path: &mut Vec<Digest>| path.push(Digest([0; 32])),
    ] {
        let mut honest = micro();
        spoil(&mut honest.witness.openings[2].path);
        let index = honest.witness.openings[2].index;
        assert_eq!(
            refused(&honest.witness),
            StatementError::NotCommitted { index }
        );
    }
}

#[test]
fn another_dataset_size_is_refused() {
    // The indices drawn are the same for both sizes under a suitable challenge; the tree's shape is not.
    let mut honest = micro();
    let header = &mut honest.witness.header;
    header.dataset.samples = 21;
    let changed = (0..).map(|i| challenge(&header.network, i, &header.node, 4, &Digest([5; 32])));
    let (challenge, indices) = changed
        .map(|challenge| (challenge, sample_indices(&challenge, 21, 1).unwrap()))
        .find(|(_, indices)| indices[0] == 19)
        .unwrap();
    header.challenge = challenge;
    header.eval_samples = 1;
    honest.witness.openings = vec![Opening {
        index: indices[0],
        sample: honest.dataset[19].clone(),
        path: merkle::path(&honest.leaves, 19).unwrap(),
    }];
    assert_eq!(
        refused(&honest.witness),
        StatementError::NotCommitted { index: 19 }
    );
}

#[test]
fn another_salt_is_refused() {
    let mut honest = micro();
    honest.witness.header.salt[0] ^= 1;
    assert_eq!(refused(&honest.witness), StatementError::Salt);
    // Even when its commitment is given along: the leaves then differ.
    honest.witness.header.dataset.salt_commitment = salt_commitment(&honest.witness.header.salt);
    assert!(matches!(
        refused(&honest.witness),
        StatementError::NotCommitted { .. }
    ));
}

#[test]
fn swapped_weights_do_not_improve() {
    let mut honest = micro();
    std::mem::swap(&mut honest.witness.base, &mut honest.witness.update);
    name_weights(&mut honest.witness);
    assert!(matches!(
        refused(&honest.witness),
        StatementError::NoImprovement { .. }
    ));
}

#[test]
fn other_weights_give_another_digest() {
    let spec = EvalSpec::micro();
    let mut honest = micro();
    let claim = check(&honest.witness).unwrap();
    let base = tensors(&spec, &mut Random(12), 1.0);
    (honest.witness.base, honest.witness.update) =
        (quantise(&spec, &base), quantise(&spec, &calmer(&base)));
    // The header names the weights; others than these are refused.
    let expected = StatementError::Weights(Model::Base);
    assert_eq!(refused(&honest.witness), expected);
    name_weights(&mut honest.witness);
    let other = check(&honest.witness).unwrap();
    assert_ne!(claim.base.quantised, other.base.quantised);
    assert_ne!(claim.update.quantised, other.update.quantised);
}

#[test]
fn the_base_itself_is_no_improvement() {
    let mut honest = micro();
    honest.witness.update = honest.witness.base.clone();
    name_weights(&mut honest.witness);
    for bps in [0, 100] {
        honest.witness.header.min_improvement_bps = bps;
        assert!(matches!(
            refused(&honest.witness),
            StatementError::NoImprovement { .. }
        ));
    }
}

#[test]
fn too_small_an_improvement_is_refused() {
    let mut honest = micro();
    let Losses::Disclosed { before, after, .. } = check(&honest.witness).unwrap().losses else {
        panic!("losses are hidden")
    };
    let achieved = ((before - after) as u128 * 10_000 / before as u128) as u32;
    honest.witness.header.min_improvement_bps = achieved;
    assert!(check(&honest.witness).is_ok());
    honest.witness.header.min_improvement_bps = achieved + 1;
    let min_improvement_bps = achieved + 1;
    let expected = StatementError::NoImprovement {
        before,
        after,
        min_improvement_bps,
    };
    assert_eq!(refused(&honest.witness), expected);
    honest.witness.header.min_improvement_bps = 10_001;
    assert_eq!(
        refused(&honest.witness),
        StatementError::MinImprovement(10_001)
    );
}

#[test]
fn improvement_is_strict_and_exact() {
    assert!(improves(10_000, 9_900, 100));
    assert!(!improves(10_000, 9_901, 100));
    assert!(improves(1, 0, 10_000));
    assert!(!improves(5, 5, 0));
    assert!(!improves(0, 0, 0));
    assert!(improves(u64::MAX, u64::MAX - 1, 0));
    assert!(!improves(u64::MAX, u64::MAX - 1, 1));
}

#[test]
fn samples_beyond_the_dataset_cannot_be_drawn() {
    let mut honest = micro();
    honest.witness.header.eval_samples = 0;
    honest.witness.openings.clear();
    assert!(matches!(refused(&honest.witness), StatementError::Draw(_)));
    let all = sample_indices(&Digest([3; 32]), 5, 5).unwrap();
    let mut sorted = all.clone();
    sorted.sort_unstable();
    assert_eq!(sorted, [0, 1, 2, 3, 4], "drawn indices are not distinct");
    assert!(sample_indices(&Digest([3; 32]), 5, 6).is_err());
}

#[test]
fn a_dataset_of_padding_alone_has_no_loss() {
    let spec = EvalSpec::micro();
    let mut honest = honest(&spec, 4, 1, 5);
    let parts = claims::Parts::random(&spec, &mut Random(1), 5, 6);
    let sample = parts.quantise(&spec);
    let leaf = leaf(&honest.witness.header.salt, &sample.digest());
    let dataset = &mut honest.witness.header.dataset;
    (dataset.root, dataset.samples) = (leaf, 1);
    honest.witness.openings = vec![Opening {
        index: 0,
        sample,
        path: vec![],
    }];
    assert_eq!(refused(&honest.witness), StatementError::NoElements);
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
    honest.witness.update = quantise(&spec, &loud);
    let StatementError::Eval {
        model: Model::Update,
        error: EvalError::OutOfRange { site, value },
        ..
    } = refused(&honest.witness)
    else {
        panic!("overflow is not reported")
    };
    assert_eq!(site, Site::Up(1));
    assert!(i16::try_from(value).is_err());
}

#[test]
fn duplicates_in_a_leaf_list_are_found() {
    let honest = micro();
    let commitment = honest.witness.header.dataset;
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
    let base = challenge(&Digest([1; 32]), 2, &NodeId([3; 32]), 4, &Digest([5; 32]));
    let others = [
        challenge(&Digest([0; 32]), 2, &NodeId([3; 32]), 4, &Digest([5; 32])),
        challenge(&Digest([1; 32]), 0, &NodeId([3; 32]), 4, &Digest([5; 32])),
        challenge(&Digest([1; 32]), 2, &NodeId([0; 32]), 4, &Digest([5; 32])),
        challenge(&Digest([1; 32]), 2, &NodeId([3; 32]), 0, &Digest([5; 32])),
        challenge(&Digest([1; 32]), 2, &NodeId([3; 32]), 4, &Digest([0; 32])),
    ];
    assert!(others.iter().all(|other| *other != base));
}

#[test]
fn a_witness_survives_its_encoding_and_truncation_is_refused() {
    let honest = micro();
    let buffers = honest.witness.to_buffers();
    assert_eq!(Witness::from_buffers(&buffers).unwrap(), honest.witness);
    for buffer in 0..buffers.len() {
        for cut in [1, 2, 8, buffers[buffer].len()] {
            let mut short = buffers.clone();
            let keep = short[buffer].len() - cut;
            short[buffer].truncate(keep);
            assert!(
                Witness::from_buffers(&short).is_err(),
                "buffer {buffer} without {cut} bytes"
            );
            let mut long = buffers.clone();
            long[buffer].extend(vec![0; cut]);
            assert!(
                Witness::from_buffers(&long).is_err(),
                "buffer {buffer} with {cut} more bytes"
            );
        }
    }
    assert_eq!(
        Witness::from_buffers(&buffers[..3]),
        Err(WitnessError::Buffers {
            found: 3,
            expected: 4
        })
    );
}

#[test]
fn later_padding_changes_nothing() {
    // Two samples that differ in a padded frame only have the same loss: attention is causal.
    let spec = EvalSpec::micro();
    let honest = micro();
    let mut parts = claims::Parts::random(&spec, &mut Random(4), 9, 2);
    let draw = zk0_circuits::challenge::draw(&spec, &Digest([6; 32]), 0);
    let first = evaluate(&spec, &honest.witness.base, &parts.quantise(&spec), &draw).unwrap();
    parts.actions[5 * 8] += 1.0;
    let second = evaluate(&spec, &honest.witness.base, &parts.quantise(&spec), &draw).unwrap();
    assert_eq!(first, second);
    assert_eq!(first.elements, 4 * 6);
}
