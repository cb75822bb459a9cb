//! A round's result is the new global weights only if its losses on the public samples allow that.

use zk0_protocol::entries::entry::RoundClosed;
use zk0_protocol::entries::round_result::{EvaluatedResult, PublicLoss, ResultOutcome};
use zk0_protocol::rules::closing::public_samples::PublicSamples;
use zk0_protocol::rules::named_blobs::{named_blobs, BlobKind, NamedBlob};
use zk0_protocol::{Body, RuleViolation};
use zk0_testkit::network::*;

const SAMPLES: PublicSamples = PUBLIC_SAMPLES;

fn overflow() -> PublicLoss {
    PublicLoss::Overflow { sample: 3 }
}

/// A round with two accepted contributions, in a network with public samples.
fn contributed() -> Chain {
    let mut founded = genesis();
    founded.rules.public_samples = Some(SAMPLES);
    let mut chain = Chain::founded(founded);
    for node in 0..2 {
        chain.apply(enrolled(node));
        chain.apply(registered(&chain.state.network().clone(), node));
    }
    chain.open();
    for node in 0..2 {
        chain.apply(committed(&chain.state, node, weights(0x10 + node)));
    }
    chain.draw();
    for node in 0..2 {
        chain.apply(accepted(&chain.state, node));
    }
    chain
}

/// The closing of that round, if its result has these losses and this outcome.
fn closing(
    chain: &Chain,
    base: PublicLoss,
    result: PublicLoss,
    outcome: ResultOutcome,
) -> RoundClosed {
    let taken = outcome == ResultOutcome::Taken;
    let result_weights = weights(0x50);
    let global = if taken { result_weights } else { weights(4) };
    let mut closing = closed(&chain.state, global);
    if !taken {
        closing
            .contributors
            .iter_mut()
            .for_each(|one| one.credits = 0);
    }
    closing.evaluated = Some(EvaluatedResult {
        weights: result_weights,
        elements: 96,
        base,
        result,
        outcome,
    });
    closing
}

fn refused_field(chain: &mut Chain, closing: RoundClosed) -> &'static str {
    match chain.refusal(Body::RoundClosed(closing)) {
        RuleViolation::RoundField { field, .. } => field,
        other => panic!("{other}"),
    }
}

#[test]
fn the_outcome_follows_from_the_losses_exactly() {
    let sum = PublicLoss::SquaredError;
    for (base, result, outcome) in [
        (sum(10_000), sum(1), ResultOutcome::Taken),
        (sum(10_000), sum(10_500), ResultOutcome::Taken),
        (sum(10_000), sum(10_501), ResultOutcome::Worse),
        (sum(0), sum(0), ResultOutcome::Taken),
        (sum(0), sum(1), ResultOutcome::Worse),
        (sum(u64::MAX), sum(u64::MAX), ResultOutcome::Taken),
        (sum(10_000), overflow(), ResultOutcome::Overflow),
        (overflow(), overflow(), ResultOutcome::Overflow),
        // Whatever does not overflow is an improvement on a base that does.
        (overflow(), sum(u64::MAX), ResultOutcome::Taken),
    ] {
        assert_eq!(SAMPLES.outcome(&base, &result), outcome, "{base} {result}");
    }
}

#[test]
fn a_result_that_overflows_or_is_worse_leaves_the_base_and_earns_nothing() {
    let base = || PublicLoss::SquaredError(10_000);
    for (result, outcome) in [
        (overflow(), ResultOutcome::Overflow),
        (PublicLoss::SquaredError(20_000), ResultOutcome::Worse),
    ] {
        let mut chain = contributed();
        // A poisoned average does not become the base, whatever the aggregator writes beside it.
        let mut taken = closing(&chain, base(), result.clone(), ResultOutcome::Taken);
        assert_eq!(
            refused_field(&mut chain, taken.clone()),
            "evaluated.outcome"
        );
        taken.evaluated.as_mut().unwrap().outcome = outcome;
        assert_eq!(refused_field(&mut chain, taken.clone()), "contributors");
        taken
            .contributors
            .iter_mut()
            .for_each(|one| one.credits = 0);
        assert_eq!(refused_field(&mut chain, taken.clone()), "global");
        taken.evaluated = None;
        taken.contributors = chain.state.contributors();
        assert_eq!(refused_field(&mut chain, taken), "evaluated");

        let right = closing(&chain, base(), result, outcome);
        assert_eq!(right.contributors.len(), 2);
        chain.apply(Body::RoundClosed(right));
        assert_eq!(chain.state.global(), &weights(4));
        assert_eq!(chain.state.results().of(0), Some(&weights(4)));
        assert!((0..2).all(|node| chain.state.node(&id(node)).unwrap().credits == 0));
        // The contributions can be disputed as always, and the next round starts from the base.
        assert_eq!(chain.state.contributions().len(), 2);
        chain.open();
        assert_eq!(chain.state.round().unwrap().opened.base, weights(4));
    }
}

#[test]
fn a_result_that_is_good_enough_is_the_new_base_and_earns_credits() {
    let mut chain = contributed();
    let (base, result) = (
        PublicLoss::SquaredError(10_000),
        PublicLoss::SquaredError(9_000),
    );
    let right = closing(&chain, base.clone(), result.clone(), ResultOutcome::Taken);
    // An aggregator cannot keep the base, or take other weights, where the result was good enough.
    let mut kept = closing(&chain, base, result, ResultOutcome::Worse);
    assert_eq!(refused_field(&mut chain, kept.clone()), "evaluated.outcome");
    kept.evaluated.as_mut().unwrap().outcome = ResultOutcome::Taken;
    kept.contributors = chain.state.contributors();
    assert_eq!(refused_field(&mut chain, kept.clone()), "global");
    kept.global = weights(0x51);
    assert_eq!(refused_field(&mut chain, kept), "global");
    chain.apply(Body::RoundClosed(right));
    assert_eq!(chain.state.global(), &weights(0x50));
    assert!((0..2).all(|node| chain.state.node(&id(node)).unwrap().credits == 100));
}

#[test]
fn nothing_is_evaluated_where_nobody_contributed_or_the_rules_name_no_samples() {
    let good = PublicLoss::SquaredError(1);
    let evaluated = |chain: &Chain| {
        let taken = ResultOutcome::Taken;
        closing(chain, good.clone(), good.clone(), taken).evaluated
    };
    // No public samples.
    let mut chain = Chain::all_committed(1);
    chain.apply(accepted(&chain.state, 0));
    let mut closing = closed(&chain.state, weights(0x50));
    closing.evaluated = evaluated(&chain);
    assert_eq!(refused_field(&mut chain, closing.clone()), "evaluated");
    closing.evaluated = None;
    chain.apply(Body::RoundClosed(closing));
    // Nobody contributed.
    let mut chain = contributed();
    let taken = super::results::closing(&chain, good.clone(), good.clone(), ResultOutcome::Taken);
    chain.apply(Body::RoundClosed(taken));
    chain.open();
    chain.close_commitments();
    let mut closing = closed(&chain.state, weights(0x50));
    assert_eq!(closing.contributors, []);
    closing.evaluated = evaluated(&chain);
    assert_eq!(refused_field(&mut chain, closing.clone()), "evaluated");
    closing.evaluated = None;
    chain.apply(Body::RoundClosed(closing));
}

#[test]
fn the_public_samples_are_a_public_blob_of_genesis_and_proposals() {
    let mut founded = genesis();
    founded.rules.public_samples = Some(SAMPLES);
    let blob = NamedBlob {
        digest: SAMPLES.blob,
        kind: BlobKind::PublicSamples,
    };
    assert!(!blob.kind.is_private_at_first());
    let rules = Box::new(founded.rules.clone());
    assert!(named_blobs(&Body::Genesis(founded)).contains(&blob));
    let chain = Chain::new();
    let action = zk0_protocol::entries::proposal::Action::ChangeRules(rules);
    let proposed = votes::proposed(&chain.state, 0, action);
    assert_eq!(named_blobs(&proposed), [blob]);
}

#[test]
fn rules_about_public_samples_are_read_from_json_and_checked() {
    let mut rules = genesis().rules;
    rules.public_samples = Some(SAMPLES);
    let text = serde_json::to_string(&rules).unwrap();
    assert!(text.contains(&SAMPLES.blob.to_string()), "{text}");
    assert_eq!(
        serde_json::from_str::<zk0_protocol::Rules>(&text).unwrap(),
        rules
    );
    assert!(rules.check().is_ok());
    let broken: [fn(&mut PublicSamples); 3] = [
        |samples| samples.samples = 0,
        |samples| samples.samples = 1025,
        |samples| samples.max_loss_increase_bps = 1_000_001,
    ];
    for breaks in broken {
        let mut samples = SAMPLES;
        breaks(&mut samples);
        rules.public_samples = Some(samples);
        let why = rules.check().unwrap_err();
        assert!(why.contains("public_samples"), "{why}");
    }
}
