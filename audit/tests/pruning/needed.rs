//! What the network itself still needs is kept, however much is pruned.

use super::*;
use ed25519_dalek::SigningKey;
use zk0_ledger::blobs::Blobs;
use zk0_ledger::folder;
use zk0_protocol::entries::entry::MomentsComputed;
use zk0_protocol::entries::signed::{Dispute, Evidence, Signed};
use zk0_protocol::rules::network_rules::Strategy;
use zk0_protocol::tlog::cosigner::Cosigner;
use zk0_protocol::WitnessPolicy;
use zk0_testkit::aggregator::operator::proposed;

/// Keeps no closed round.
const NO_ROUND: Retention = Retention {
    rounds: Some(0),
    without_proofs: true,
    without_weights: true,
    checkpoint_interval: None,
};

/// Which rounds' weights are there after pruning.
fn weights_after(operator: Operator, dir: &Path, keep: &Retention) -> Vec<u8> {
    let (rounds, now_ms) = (operator.state().next_round() as u8, operator.time_ms);
    drop(operator);
    prune(dir, keep, now_ms);
    let blobs = Blobs::at(dir);
    assert!(
        blobs.contains(&blob_digest(&weights(0))),
        "the initial ones"
    );
    (0..rounds)
        .filter(|round| blobs.contains(&blob_digest(&global(*round))))
        .collect()
}

fn after(rounds: usize, genesis: Genesis, dir: &Path) -> Operator {
    let mut operator = founded(dir, genesis);
    (0..rounds).for_each(|_| round(&mut operator, None));
    operator
}

#[test]
fn the_newest_weights_are_kept_and_those_before_them_for_their_momentum() {
    let dir = tempfile::tempdir().unwrap();
    let operator = after(4, genesis(), dir.path());
    assert_eq!(weights_after(operator, dir.path(), &NO_ROUND), [2, 3]);

    // An audit of a kept round reads what its strategy read.
    let one_round = Retention {
        rounds: Some(1),
        ..NO_ROUND
    };
    let momentum = Strategy::FedAvgM {
        server_rate_bps: 10_000,
        momentum_bps: 9_000,
    };
    for (strategy, kept) in [(Strategy::FedAvg, vec![2, 3]), (momentum, vec![1, 2, 3])] {
        let dir = tempfile::tempdir().unwrap();
        let mut genesis = genesis();
        genesis.rules.strategy = strategy;
        let operator = after(4, genesis, dir.path());
        assert_eq!(weights_after(operator, dir.path(), &one_round), kept);
        let (report, _) = audit(dir.path(), Depth::Full);
        assert_eq!(faults(&report), [] as [&str; 0]);
    }
}

/// A network whose rounds combine by FedAdam.
fn adam() -> Genesis {
    let mut genesis = genesis();
    genesis.rules.strategy = Strategy::FedAdam {
        server_rate_billionths: 1_000_000,
        beta1_bps: 9_000,
        beta2_bps: 9_900,
        tau_billionths: 1_000_000,
    };
    genesis
}

/// A round whose moments are this file.
fn round_of_adam(operator: &mut Operator, moments: &[u8]) {
    let number = operator.state().next_round() as u8;
    operator.open();
    let (node, update, proof) = (SigningNode::new(1), update(number, 1), proof(number, 1));
    operator.commit(&node, &update);
    operator.draw();
    let submission = operator.submission_of(&node, &update, &proof);
    operator.append(Body::ContributionAccepted(submission));
    operator.ledger.blobs().put(moments).unwrap();
    operator.append(Body::MomentsComputed(MomentsComputed {
        round: number.into(),
        moments: blob_digest(moments),
    }));
    operator.close(seed(number, 9));
    operator.time_ms += 2_000;
}

#[test]
fn moments_are_kept_that_a_kept_round_goes_on_from() {
    for (rounds, kept) in [(0, vec![3]), (1, vec![2, 3]), (2, vec![1, 2, 3])] {
        let dir = tempfile::tempdir().unwrap();
        let mut operator = founded(dir.path(), adam());
        (0..4).for_each(|number| round_of_adam(&mut operator, &[number, 9]));
        let now_ms = operator.time_ms;
        drop(operator);
        let keep = Retention {
            rounds: Some(rounds),
            ..NO_ROUND
        };
        prune(dir.path(), &keep, now_ms);
        let blobs = Blobs::at(dir.path());
        let there = |number: &u8| blobs.contains(&blob_digest(&[*number, 9]));
        let left: Vec<u8> = (0..4).filter(there).collect();
        assert_eq!(left, kept, "{rounds} rounds");
        // The operator has signed that the others are gone.
        let (report, _) = audit(dir.path(), Depth::Light);
        assert_eq!(faults(&report), [] as [&str; 0]);
    }
}

#[test]
fn moments_that_were_pruned_are_not_called_missing_where_weights_are_kept() {
    let dir = tempfile::tempdir().unwrap();
    let mut operator = founded(dir.path(), adam());
    (0..4).for_each(|number| round_of_adam(&mut operator, &[number, 9]));
    let now_ms = operator.time_ms;
    drop(operator);
    prune(dir.path(), &TWO_ROUNDS, now_ms);
    let (report, auditor) = audit(dir.path(), Depth::Full);
    assert_eq!(faults(&report), [] as [&str; 0]);
    assert_eq!(left_out(&auditor, CheckKind::Moments), 1);
    let lines = auditor.not_checked();
    let missing = lines
        .iter()
        .filter(|line| line.why == SkipReason::NotAtHand);
    assert_eq!(missing.count(), 0, "{lines:?}");
}

#[test]
fn rounds_whose_end_no_witness_has_cosigned_are_kept() {
    let dir = tempfile::tempdir().unwrap();
    let operator = after(2, genesis(), dir.path());
    let now_ms = operator.time_ms;
    drop(operator);
    let of = || {
        let plan = PrunePlan::look(dir.path(), &Blobs::at(dir.path()), &NO_ROUND, now_ms).unwrap();
        (plan.first_kept, plan.longer)
    };
    assert_eq!(of(), (2, None));
    let witness = SigningKey::from_bytes(&[200; 32]);
    let witness = Cosigner::new("witness.example/w", witness).unwrap();
    let policy = format!("witness W {}\nquorum W\n", witness.key());
    let policy = WitnessPolicy::parse(&policy).unwrap();
    folder::write_policy(dir.path(), &policy).unwrap();
    assert_eq!(of(), (0, Some(Longer::NotCosigned(0))));
}

#[test]
fn weights_that_an_open_vote_can_restore_are_kept() {
    let dir = tempfile::tempdir().unwrap();
    let mut operator = after(5, genesis(), dir.path());
    let action = Action::RestoreWeights { round: 1 };
    operator.append(proposed(operator.state(), action));
    assert_eq!(weights_after(operator, dir.path(), &NO_ROUND), [1, 3, 4]);
}

#[test]
fn restored_weights_are_kept_as_the_base_of_the_rounds_after_them() {
    let dir = tempfile::tempdir().unwrap();
    let mut operator = after(4, genesis(), dir.path());
    operator.decide(Action::RestoreWeights { round: 0 });
    assert_eq!(operator.state().global().blob, blob_digest(&global(0)));
    round(&mut operator, None);
    round(&mut operator, None);
    let two_rounds = Retention {
        rounds: Some(2),
        ..NO_ROUND
    };
    // Round 4 started from what round 0 ended with.
    assert_eq!(weights_after(operator, dir.path(), &two_rounds), [0, 4, 5]);
    let (report, _) = audit(dir.path(), Depth::Full);
    assert_eq!(faults(&report), [] as [&str; 0]);
}

#[test]
fn the_weights_of_the_policy_folder_that_was_due_last_are_kept() {
    for (interval, kept) in [
        (1, vec![5, 6]),
        (2, vec![5, 6]),
        (3, vec![5, 6]),
        (4, vec![3, 5, 6]),
        (5, vec![4, 5, 6]),
        (8, vec![5, 6]),
    ] {
        let dir = tempfile::tempdir().unwrap();
        let operator = after(7, genesis(), dir.path());
        let keep = Retention {
            checkpoint_interval: Some(interval),
            ..NO_ROUND
        };
        let found = weights_after(operator, dir.path(), &keep);
        assert_eq!(found, kept, "{interval}");
    }
}

#[test]
fn a_contribution_under_dispute_is_kept_until_it_is_decided() {
    let dir = tempfile::tempdir().unwrap();
    let mut operator = founded(dir.path(), genesis());
    round(&mut operator, None);
    operator.time_ms -= 2_000;
    let contribution = *operator.state().contributions().keys().next().unwrap();
    let disputer = SigningNode::new(3);
    let dispute = Dispute {
        network: *operator.state().network(),
        disputer: disputer.id(),
        contribution,
        evidence: Evidence::Verification,
    };
    operator.append(Body::Disputed(Signed::new(dispute, &disputer.key)));
    // The time for disputes is over long ago, and this one is not decided.
    let now_ms = operator.time_ms + 1_000_000;
    drop(operator);
    let plan = prune(dir.path(), &NO_ROUND, now_ms);
    assert_eq!(plan.longer, Some(Longer::Disputable(0)));
    for blob in [update(0, 1), proof(0, 1)] {
        assert!(Blobs::at(dir.path()).contains(&blob_digest(&blob)));
    }
}

#[test]
fn everything_of_the_open_round_is_kept() {
    let dir = tempfile::tempdir().unwrap();
    let mut operator = after(1, genesis(), dir.path());
    operator.open();
    for node in [1, 2, 3] {
        operator.commit(&SigningNode::new(node), &update(1, node));
    }
    operator.draw();
    let late = operator.submission_of(&SigningNode::new(2), &update(1, 2), &proof(1, 2));
    operator.append(Body::ContributionRejected {
        submission: late,
        reason: RefusalCode::MalformedProof,
    });
    let now_ms = operator.time_ms;
    drop(operator);
    prune(dir.path(), &NO_ROUND, now_ms);
    let blobs = Blobs::at(dir.path());
    for blob in [update(1, 1), update(1, 2), update(1, 3), proof(1, 2)] {
        assert!(blobs.contains(&blob_digest(&blob)));
    }
}
