//! How much a contribution counts, and what it earns: declared samples gain nothing, or little.

use proptest::prelude::*;
use zk0_circuits::claim::challenge::MAX_EVAL_SAMPLES;
use zk0_protocol::entries::entry::Contributor;
use zk0_protocol::entries::signed::{DatasetRegistration, UpdateCommitment};
use zk0_protocol::rules::closing::credits::CreditRule;
use zk0_protocol::rules::closing::shares::{Shares, WHOLE_SHARE};
use zk0_protocol::{Body, Signed};
use zk0_testkit::network::*;

const TWICE: Shares = Shares::Samples {
    max_of_median_bps: 20_000,
};

#[test]
fn equal_shares_do_not_look_at_samples() {
    assert_eq!(Shares::Equal.of(&[1, u64::MAX, 7]), [WHOLE_SHARE; 3]);
    assert!(Shares::Equal.of(&[]).is_empty());
}

#[test]
fn shares_by_samples_are_of_the_median_and_limited() {
    // Of an odd number the median is the one in the middle.
    assert_eq!(TWICE.of(&[30, 10, 20]), [15_000, 5_000, 10_000]);
    // Of an even number it is the smaller of the two in the middle.
    assert_eq!(TWICE.of(&[40, 10, 20, 30]), [20_000, 5_000, 10_000, 15_000]);
    assert_eq!(TWICE.of(&[10, 1_000_000]), [10_000, 20_000]);
    // A share is rounded down, and it is never nothing.
    assert_eq!(TWICE.of(&[1, 3, 3]), [3_333, 10_000, 10_000]);
    assert_eq!(TWICE.of(&[1, u64::MAX, u64::MAX]), [1, 10_000, 10_000]);
    assert_eq!(TWICE.of(&[5]), [10_000]);
    assert!(TWICE.of(&[]).is_empty());
}

#[test]
fn credits_are_the_proven_improvement_times_the_share() {
    let rule = CreditRule {
        bps_per_credit: 100,
        max_per_contribution: 500,
        dispute_window_ms: 0,
    };
    assert_eq!(rule.earned(1000, WHOLE_SHARE), 10);
    assert_eq!(rule.earned(1099, WHOLE_SHARE), 10);
    assert_eq!(rule.earned(99, WHOLE_SHARE), 0);
    assert_eq!(rule.earned(1000, WHOLE_SHARE / 2), 5);
    assert_eq!(rule.earned(u64::MAX, u32::MAX), 500);
    let none = CreditRule {
        max_per_contribution: 0,
        ..rule
    };
    assert_eq!(none.earned(1000, WHOLE_SHARE), 0);
}

/// A round with three contributors, whose datasets have these numbers of samples. Each lowers the loss by a tenth.
fn contributors(shares: Shares, samples: [u64; 3]) -> Vec<Contributor> {
    let mut founded = genesis();
    founded.rules.shares = shares;
    founded.rules.evaluation_frames = MAX_EVAL_SAMPLES;
    let mut chain = Chain::founded(founded);
    let network = *chain.state.network();
    for (node, samples) in (0..).zip(samples) {
        chain.apply(enrolled(node));
        let mut registration: DatasetRegistration = registration(&network, node);
        registration.dataset.samples = samples;
        registration.evaluation_frames = MAX_EVAL_SAMPLES;
        registration.episodes[0].frames = 10_000;
        chain.apply(Body::DatasetCommitted(Signed::new(
            registration,
            &key(node),
        )));
    }
    chain.open();
    for node in 0..3 {
        let commitment: UpdateCommitment = commitment(&chain.state, node, weights(0x10 + node));
        chain.apply(Body::UpdateCommitted(Signed::new(commitment, &key(node))));
    }
    chain.draw();
    for node in 0..3 {
        chain.apply(accepted(&chain.state, node));
    }
    let closing = closed(&chain.state, weights(0x50));
    let contributors = closing.contributors.clone();
    chain.apply(Body::RoundClosed(closing));
    for one in &contributors {
        assert_eq!(chain.state.node(&one.node).unwrap().credits, one.credits);
    }
    (0..3)
        .map(|node| {
            *contributors
                .iter()
                .find(|one| one.node == id(node))
                .unwrap()
        })
        .collect()
}

#[test]
fn thousands_of_leaves_that_differ_in_a_bit_gain_nothing() {
    // Nodes 0 and 1 have recorded 64 samples each. Node 2 has one sample, and commits to as many variants of it as an evaluation set can
    // have.
    let most = u64::from(MAX_EVAL_SAMPLES);
    let honest = contributors(Shares::Equal, [64, 64, 64]);
    let inflated = contributors(Shares::Equal, [64, 64, most]);
    assert_eq!(inflated, honest);
    assert_eq!(inflated[2].share, inflated[0].share);
    assert_eq!(inflated[2].credits, inflated[0].credits);

    // Where samples count, the median limits what the variants gain. At a limit of the median itself, they gain nothing here either.
    let median = Shares::Samples {
        max_of_median_bps: WHOLE_SHARE,
    };
    assert_eq!(contributors(median, [64, 64, most]), honest);
    let twice = contributors(TWICE, [64, 64, most]);
    assert_eq!((twice[2].share, twice[2].credits), (20_000, 200));
    assert_eq!(contributors(TWICE, [64, 64, 1_000]), twice);
    assert_eq!(TWICE.of(&[64, 64, 10_000]), TWICE.of(&[64, 64, most]));
    assert_eq!(twice[..2], honest[..2]);
}

proptest! {
    #[test]
    fn nobody_counts_for_more_than_the_limit_and_more_samples_never_count_less(
        samples in proptest::collection::vec(1u64.., 1..40),
        max_of_median_bps in 10_000u32..=1_000_000,
    ) {
        let shares = Shares::Samples { max_of_median_bps }.of(&samples);
        prop_assert_eq!(shares.len(), samples.len());
        prop_assert!(shares.iter().all(|share| (1..=max_of_median_bps).contains(share)));
        for (one, share) in samples.iter().zip(&shares) {
            for (other, its) in samples.iter().zip(&shares) {
                prop_assert!(one > other || share <= its);
            }
        }
        // One contributor in the middle has the whole share, and at least half have no more than that.
        prop_assert!(shares.contains(&WHOLE_SHARE));
        let up_to_whole = shares.iter().filter(|share| **share <= WHOLE_SHARE).count();
        prop_assert!(2 * up_to_whole >= samples.len());
    }
}
