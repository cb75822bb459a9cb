//! The folder keeps the last checkpoint that witnesses have cosigned. At a start, it decides whether one of them has to answer first.

use ed25519_dalek::SigningKey;
use std::path::Path;
use std::sync::Arc;
use zk0_aggregator::{Aggregator, Config};
use zk0_circuits::Digest;
use zk0_ledger::folder;
use zk0_protocol::entries::proposal::Action;
use zk0_protocol::tlog::checkpoint::Parsed;
use zk0_protocol::tlog::cosigner::Cosigner;
use zk0_protocol::{Checkpoint, Rules, WitnessPolicy};
use zk0_testkit::aggregator::operator::Operator;
use zk0_testkit::aggregator::*;

/// A witness, and the policy that asks for it alone.
fn witness(number: u8) -> (Cosigner, WitnessPolicy) {
    let secret = SigningKey::from_bytes(&[200 + number; 32]);
    let cosigner = Cosigner::new(&format!("witness.example/w{number}"), secret).unwrap();
    let line = format!("witness W {} http://127.0.0.1:1\n", cosigner.key());
    let policy = WitnessPolicy::parse(&format!("{line}quorum W\n")).unwrap();
    (cosigner, policy)
}

/// A checkpoint with this witness' cosignature.
fn cosigned(checkpoint: &[u8], by: &Cosigner) -> Vec<u8> {
    let parsed = Parsed::read(checkpoint).unwrap();
    let cosignature = by.cosign(parsed.note.text(), START_MS / 1000);
    [checkpoint, &cosignature].concat()
}

/// Changes the last signature.
fn damaged(mut note: Vec<u8>) -> Vec<u8> {
    let at = note.len() - 10;
    note[at] = if note[at] == b'A' { b'B' } else { b'A' };
    note
}

/// Founds a network whose rules ask for the first policy, and then, by a vote, for the second one. Returns the checkpoints before and after
/// that.
fn voted_away(dir: &Path, first: &WitnessPolicy, second: &WitnessPolicy) -> [Vec<u8>; 2] {
    let mut genesis = genesis();
    genesis.rules.witness_policy = first.text().into();
    let node = SigningNode::new(1);
    let mut operator = Operator::founds(dir, genesis, &[&node]);
    let before = operator.ledger.checkpoint().to_vec();
    let rules = Rules {
        witness_policy: second.text().into(),
        ..operator.state().rules().clone()
    };
    operator.decide(Action::ChangeRules(Box::new(rules)));
    [before, operator.ledger.checkpoint().to_vec()]
}

fn opened(dir: &Path) -> Aggregator {
    let clock = Arc::new(ManualClock::at(START_MS + 2 * VOTING_MS));
    let config = Config {
        rounds: Some(1),
        min_nodes: 1,
    };
    Aggregator::open(dir, None, log_key(), clock, config).unwrap()
}

/// A start with a new policy asks no witness whether the ledger is the newest one.
#[test]
fn only_a_vote_since_the_last_cosigned_checkpoint_makes_a_policy_new() {
    let dir = tempfile::tempdir().unwrap();
    let [(former, first), (present, second), (_, third)] = [1, 2, 3].map(witness);
    let [before, after] = voted_away(dir.path(), &first, &second);
    let aggregator = opened(dir.path());
    let size = |text: &[u8]| Parsed::read(text).unwrap().checkpoint.size;
    assert!(!aggregator.is_new_policy(&second).unwrap());
    for (signed, by, accepted, is_new) in [
        (&before, Some(&former), false, true),
        (&before, None, false, true),
        (&after, Some(&former), false, false),
        (&after, None, false, false),
        (&after, Some(&present), true, false),
    ] {
        let note = by.map_or_else(|| signed.clone(), |by| cosigned(signed, by));
        folder::write_cosigned(dir.path(), &note).unwrap();
        let held = aggregator.cosigned(&second).unwrap();
        assert_eq!(held, Some((size(signed), accepted)));
        assert_eq!(aggregator.is_new_policy(&second).unwrap(), is_new);
        // The operator can replace its own policy without a vote.
        assert!(!aggregator.is_new_policy(&third).unwrap());
    }
}

#[test]
fn a_damaged_cosigned_checkpoint_makes_no_policy_new() {
    let dir = tempfile::tempdir().unwrap();
    let [(former, first), (present, second)] = [1, 2].map(witness);
    let [before, after] = voted_away(dir.path(), &first, &second);
    let aggregator = opened(dir.path());
    let refusal = |note: &[u8]| {
        folder::write_cosigned(dir.path(), note).unwrap();
        let refused = aggregator.cosigned(&second).unwrap_err().to_string();
        let is_new = aggregator.is_new_policy(&second).map_err(|e| e.to_string());
        assert_eq!(is_new, Err(refused.clone()));
        refused
    };
    let signed = |size, root: Digest, log: &str| {
        let checkpoint = Checkpoint { size, root };
        checkpoint.sign(log, &log_key()).unwrap()
    };
    let (root, name) = (
        Parsed::read(&after).unwrap().checkpoint.root,
        genesis().name,
    );
    let path = folder::cosigned(dir.path()).display().to_string();
    for note in [
        Vec::new(),
        b"garbage".to_vec(),
        damaged(before.clone()),
        damaged(cosigned(&after, &present)),
        cosigned(&signed(1, root, "another.example/zk0"), &former),
    ] {
        let why = refusal(&note);
        assert!(
            why.starts_with(&path) && why.contains("Move the file away"),
            "{why}"
        );
    }
    // The log has signed more than the ledger has, or another history.
    for (size, why) in [(99, "rolled back"), (1, "the history was changed")] {
        let refused = refusal(&cosigned(&signed(size, root, &name), &former));
        assert!(refused.contains(why), "{refused}");
    }
}
