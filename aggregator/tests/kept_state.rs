//! A start goes on from the state that an aggregator has kept, and has what a replay of the whole history has.

use crate::pruning::{proof, rounds, update, CONFIG};
use std::fs;
use std::path::Path;
use std::sync::Arc;
use zk0_aggregator::Aggregator;
use zk0_circuits::Digest;
use zk0_ledger::store::digest_set::DigestSet;
use zk0_ledger::{folder, Ledger};
use zk0_protocol::Body;
use zk0_testkit::aggregator::operator::Operator;
use zk0_testkit::aggregator::*;
use zk0_verifier::blob_digest;

fn opened(dir: &Path) -> Aggregator {
    let state = Ledger::open(dir, None, log_key()).unwrap().state().clone();
    let clock = Arc::new(ManualClock::at(state.time_ms() + 1));
    Aggregator::open(dir, None, log_key(), clock, CONFIG).unwrap()
}

/// The operator of the ledger in `dir` goes on.
fn operator(dir: &Path) -> Operator {
    let ledger = Ledger::open(dir, None, log_key()).unwrap();
    let time_ms = ledger.state().time_ms() + 2_000;
    Operator { ledger, time_ms }
}

/// One more closed round, whose update is that of this number.
fn one_round(dir: &Path, number: u32) {
    let (mut operator, node) = (operator(dir), SigningNode::new(1));
    operator.open();
    let submission = operator.submission_of(&node, &update(number), &proof(number));
    operator.append(Body::ContributionAccepted(submission));
    operator.close(200 + number);
}

/// A ledger of three closed rounds, with a kept state. Returns how many entries that covers.
fn kept(dir: &Path) -> u64 {
    drop(rounds(dir, genesis(), 3));
    let mut aggregator = opened(dir);
    assert_eq!(aggregator.kept_entries(), 0);
    assert!(aggregator.keep_state().unwrap());
    assert_eq!(aggregator.kept_entries(), aggregator.ledger().size());
    aggregator.kept_entries()
}

fn forget(dir: &Path) {
    fs::remove_file(folder::state(dir)).unwrap();
    fs::remove_dir_all(folder::public(dir)).unwrap();
}

/// What an aggregator knows: the state's digest, its rounds, and which of these blobs are public.
fn known(aggregator: &Aggregator, blobs: &[Digest]) -> (Digest, Vec<String>, Vec<bool>) {
    let size = aggregator.ledger().size();
    let rounds = (0..6).map(|round| format!("{:?}", aggregator.round(Some(round), size)));
    let public = blobs.iter().map(|blob| aggregator.blob(blob).is_ok());
    (
        aggregator.state().digest(),
        rounds.collect(),
        public.collect(),
    )
}

/// The proofs and updates of these rounds, and a blob that no entry names.
fn blobs(rounds: u32) -> Vec<Digest> {
    let of_rounds = (0..rounds).flat_map(|round| [update(round), proof(round)]);
    let all = of_rounds.chain([b"named by nobody".to_vec()]);
    all.map(|blob| blob_digest(&blob)).collect()
}

/// Starts, which has to go on from `kept` entries, and again without the kept state: both know the same.
#[track_caller]
fn knows_what_a_replay_knows(dir: &Path, kept: u64, rounds: u32) {
    let blobs = blobs(rounds);
    let went_on = opened(dir);
    assert_eq!(went_on.kept_entries(), kept);
    let knows = known(&went_on, &blobs);
    drop(went_on);
    forget(dir);
    let replayed = opened(dir);
    assert_eq!(replayed.kept_entries(), 0);
    assert_eq!(knows, known(&replayed, &blobs));
    let (named, other) = knows.2.split_at(blobs.len() - 1);
    assert!(named.iter().all(|public| *public) && other == [false]);
}

#[test]
fn a_start_from_the_kept_state_knows_what_a_replay_knows() {
    for more in 0..3 {
        let dir = tempfile::tempdir().unwrap();
        let kept = kept(dir.path());
        for round in 0..more {
            one_round(dir.path(), 3 + round);
        }
        knows_what_a_replay_knows(dir.path(), kept, 3 + more);
    }
}

#[test]
fn the_state_is_kept_again_and_again() {
    let dir = tempfile::tempdir().unwrap();
    let mut last = kept(dir.path());
    for round in 3..6 {
        one_round(dir.path(), round);
        let mut aggregator = opened(dir.path());
        assert_eq!(aggregator.kept_entries(), last);
        // Little is new.
        assert!(aggregator.state_to_keep().is_none());
        assert!(aggregator.keep_state().unwrap());
        last = aggregator.kept_entries();
        assert_eq!(last, aggregator.ledger().size());
        let (_, _, public) = known(&aggregator, &blobs(round + 1));
        let named = public.len() - 1;
        assert!(public[..named].iter().all(|public| *public));
    }
    knows_what_a_replay_knows(dir.path(), last, 6);
}

/// The public blobs are written first.
#[test]
fn killed_between_the_public_blobs_and_the_state_a_start_is_right() {
    let dir = tempfile::tempdir().unwrap();
    let kept = kept(dir.path());
    let older = fs::read(folder::state(dir.path())).unwrap();
    one_round(dir.path(), 3);
    assert!(opened(dir.path()).keep_state().unwrap());
    fs::write(folder::state(dir.path()), older).unwrap();
    knows_what_a_replay_knows(dir.path(), kept, 4);
}

#[test]
fn a_state_without_its_public_blobs_does_not_count() {
    let dir = tempfile::tempdir().unwrap();
    let older = tempfile::tempdir().unwrap();
    kept(dir.path());
    copy_folder(&folder::public(dir.path()), older.path());
    one_round(dir.path(), 3);
    assert!(opened(dir.path()).keep_state().unwrap());
    let public = folder::public(dir.path());
    fs::remove_dir_all(&public).unwrap();
    let replays = || {
        let aggregator = opened(dir.path());
        assert_eq!(aggregator.kept_entries(), 0);
        let public = known(&aggregator, &blobs(4)).2;
        assert!(public[..8].iter().all(|public| *public));
    };
    replays();
    // Those of an earlier state are too few.
    copy_folder(older.path(), &public);
    replays();
}

#[test]
fn public_blobs_that_cannot_be_opened_are_read_again() {
    let dir = tempfile::tempdir().unwrap();
    kept(dir.path());
    let public = folder::public(dir.path());
    // A reader needs no lock.
    fs::remove_file(public.join("LOCK")).unwrap();
    fs::create_dir(public.join("LOCK")).unwrap();
    assert!(DigestSet::covered(&public).unwrap() > 0);
    let refused = DigestSet::open(&public).err().unwrap().to_string();
    assert!(
        refused.starts_with(&public.display().to_string()),
        "{refused}"
    );
    assert!(refused.contains("Delete this folder"), "{refused}");
    let mut aggregator = opened(dir.path());
    assert_eq!(aggregator.kept_entries(), 0);
    let known = known(&aggregator, &blobs(3)).2;
    assert!(known[..6].iter().all(|public| *public));
    assert!(aggregator.keep_state().unwrap());
    let kept = aggregator.kept_entries();
    drop(aggregator);
    knows_what_a_replay_knows(dir.path(), kept, 3);
}

fn copy_folder(from: &Path, to: &Path) {
    fs::create_dir_all(to).unwrap();
    for file in fs::read_dir(from).unwrap() {
        let file = file.unwrap();
        fs::copy(file.path(), to.join(file.file_name())).unwrap();
    }
}

/// The ledger alone has what the open round has accepted.
#[test]
fn no_state_is_kept_while_the_open_round_has_accepted_something() {
    let dir = tempfile::tempdir().unwrap();
    drop(rounds(dir.path(), genesis(), 1));
    let (mut operator, node) = (operator(dir.path()), SigningNode::new(1));
    operator.open();
    let submission = operator.submission_of(&node, &update(1), &proof(1));
    operator.append(Body::ContributionAccepted(submission));
    // Its proof is lost, so it is not verified again.
    let lost = operator.ledger.blobs().path(&blob_digest(&proof(1)));
    fs::remove_file(lost).unwrap();
    drop(operator);
    assert!(!opened(dir.path()).keep_state().unwrap());
    assert!(!folder::state(dir.path()).exists());
}

/// What is private stays private: the next round is open, and has a commitment.
#[test]
fn a_start_from_the_kept_state_holds_back_what_is_private() {
    let dir = tempfile::tempdir().unwrap();
    drop(rounds(dir.path(), genesis(), 1));
    let (mut operator, node) = (operator(dir.path()), SigningNode::new(1));
    operator.open();
    operator.commit(&node, &update(1));
    drop(operator);
    assert!(opened(dir.path()).keep_state().unwrap());
    let aggregator = opened(dir.path());
    assert_eq!(aggregator.kept_entries(), aggregator.ledger().size());
    let refused = aggregator.blob(&blob_digest(&update(1))).err().unwrap();
    assert!(refused.to_string().contains("private"), "{refused}");
    assert!(aggregator.blob(&blob_digest(&update(0))).is_ok());
}

/// Otherwise a node could take anything away from the others, also the weights that they start from, by a commitment to it.
#[test]
fn what_is_public_stays_so_if_the_open_round_names_it_again() {
    let dir = tempfile::tempdir().unwrap();
    let kept = kept(dir.path());
    let (mut operator, node) = (operator(dir.path()), SigningNode::new(1));
    operator.open();
    operator.commit(&node, &update(0));
    drop(operator);
    let public = blob_digest(&update(0));
    let went_on = opened(dir.path());
    assert_eq!(went_on.kept_entries(), kept);
    assert!(went_on.blob(&public).is_ok());
    drop(went_on);
    forget(dir.path());
    assert!(opened(dir.path()).blob(&public).is_ok());
}
