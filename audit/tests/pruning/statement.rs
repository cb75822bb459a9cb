//! The statement about pruned blobs: whose it is, what it is about, and where it goes.

use super::*;
use borsh::BorshDeserialize;
use std::fs;
use std::time::Duration;
use zk0_audit::fetch::behind::{LogBehind, Shortfall};
use zk0_audit::fetch::{fetch, is_wrong, WantedBlobs};
use zk0_audit::log_source::source;
use zk0_audit::run::Audit;
use zk0_audit::trusted_programs::TrustedPrograms;
use zk0_ledger::backup::backup;
use zk0_ledger::prune::PruneError;
use zk0_ledger::published::export::export;
use zk0_ledger::published::mirror::MirrorError;
use zk0_ledger::published::publication::Publication;
use zk0_ledger::replay::{SaveOptions as KeepState, SavedReplay};
use zk0_protocol::entries::member::NodeEnrolled;
use zk0_protocol::pruning::Pruning;
use zk0_protocol::tlog::key_rotation::LogKeyRotation;
use zk0_protocol::Signed;
use zk0_testkit::network::log_keys::*;

/// The statement in `dir`.
fn statement(dir: &Path) -> Pruning {
    let bytes = fs::read(dir.join("pruned")).unwrap();
    let signed: Signed<Pruning> = borsh::from_slice(&bytes).unwrap();
    signed.verify().unwrap();
    signed.statement
}

fn write(dir: &Path, statement: Pruning, key: &ed25519_dalek::SigningKey) {
    fs::write(dir.join("pruned"), signed(statement, key)).unwrap();
}

fn signed(statement: Pruning, key: &ed25519_dalek::SigningKey) -> Vec<u8> {
    borsh::to_vec(&Signed::new(statement, key)).unwrap()
}

/// Brings the mirror `to` up to date from the log in the folder `from`.
fn follow(from: &Path, to: &Path) -> Result<(), MirrorError> {
    let source = source(from.to_str().unwrap(), None).unwrap();
    fetch(source.as_ref(), to, None, None, WantedBlobs::Everything)
}

#[test]
fn only_a_statement_of_the_log_about_rounds_that_had_closed_counts() {
    let (dir, now_ms) = four_rounds();
    let dir = dir.path();
    prune(dir, &TWO_ROUNDS, now_ms);
    let true_one = statement(dir);
    assert_eq!(true_one.updates_before, 2);
    assert_eq!((true_one.proofs_before, true_one.weights_before), (0, 0));
    let (report, _) = audit(dir, Depth::Full);
    assert_eq!(faults(&report), [] as [&str; 0]);
    let stranger = SigningNode::new(7);
    let fails = |words: &str| {
        let (report, _) = audit(dir, Depth::Full);
        assert_eq!(report.verdict, Verdict::Failed);
        let faults = faults(&report);
        let found = faults.iter().any(|fault| fault.contains(words));
        assert!(found, "{words}: {faults:?}");
    };
    let of_the_stranger = Pruning {
        operator: stranger.id(),
        ..true_one
    };
    write(dir, of_the_stranger, &stranger.key);
    fails("and not the log's key");
    write(dir, true_one, &stranger.key);
    fails("signature");
    let of_another_network = Pruning {
        network: Digest([1; 32]),
        ..true_one
    };
    write(dir, of_another_network, &log_key());
    fails("it is about network 0101");
    fs::write(dir.join("pruned"), b"pruned").unwrap();
    fails("does not hold a statement about pruned blobs that counts");
    // An operator who signs once that nothing is ever kept has stated nothing about rounds that close later.
    let of_the_future = Pruning {
        entries: true_one.entries - 1,
        updates_before: u64::MAX,
        ..true_one
    };
    write(dir, of_the_future, &log_key());
    fails("is missing, and the round has closed");
    let of_more_than_there_is = Pruning {
        entries: u64::MAX,
        ..of_the_future
    };
    write(dir, of_more_than_there_is, &log_key());
    fails("ROLLED BACK");
    fs::remove_file(dir.join("pruned")).unwrap();
    fails("is missing, and the round has closed");
}

/// The operator's statement about the key stands beside it.
#[test]
fn a_later_key_of_the_log_signs_what_was_pruned() {
    let (dir, now_ms) = four_rounds();
    let dir = dir.path();
    let blobs = Blobs::at(dir);
    let opened = Ledger::open_to_rotate(dir, None, later_key(1), None, blobs, &mut ());
    let mut ledger = opened.unwrap();
    ledger.rotate_key(&log_key(), now_ms).unwrap();
    let thief = SigningNode::new(7);
    let by_thief = LogKeyRotation {
        operator: thief.id(),
        ..log_rotation(ledger.state(), &thief.key)
    };
    let plan = PrunePlan::of(&ledger, &TWO_ROUNDS, now_ms).unwrap();
    plan.carry_out(&ledger).unwrap();
    drop(ledger);
    let (report, _) = audit(dir, Depth::Full);
    assert_eq!(faults(&report), [] as [&str; 0]);
    let file = fs::read(dir.join("pruned")).unwrap();
    let true_one = Signed::<Pruning>::deserialize(&mut &file[..]).unwrap();
    let of_the_thief = Pruning {
        operator: thief.id(),
        ..true_one.statement
    };
    let by_thief = borsh::to_vec(&Signed::new(by_thief, &thief.key)).unwrap();
    let forged = [signed(of_the_thief, &thief.key), by_thief].concat();
    fs::write(dir.join("pruned"), forged).unwrap();
    let (report, _) = audit(dir, Depth::Full);
    let faults = faults(&report);
    let words = "has not signed the statement about its key";
    let found = faults.iter().any(|fault| fault.contains(words));
    assert!(found, "{faults:?}");
}

/// A thief of it would have the present key sign that nothing is kept.
#[test]
fn what_a_former_key_has_signed_is_in_no_later_statement() {
    let (dir, now_ms) = four_rounds();
    let dir = dir.path();
    let opened = Ledger::open_to_rotate(dir, None, later_key(1), None, Blobs::at(dir), &mut ());
    let mut ledger = opened.unwrap();
    ledger.rotate_key(&log_key(), now_ms).unwrap();
    let by_former = Pruning {
        network: *ledger.state().network(),
        operator: public(&log_key()),
        entries: ledger.size(),
        updates_before: u64::MAX,
        proofs_before: u64::MAX,
        weights_before: u64::MAX,
    };
    write(dir, by_former, &log_key());
    let kept = || fs::read_dir(dir.join("blobs/sha256")).unwrap().count();
    let before = kept();
    let looked = PrunePlan::look(dir, ledger.blobs(), &TWO_ROUNDS, now_ms);
    for refused in [PrunePlan::of(&ledger, &TWO_ROUNDS, now_ms), looked] {
        let refused = refused.unwrap_err();
        let former = matches!(
            refused,
            PruneError::Ledger(LedgerError::FormerPruning { .. })
        );
        assert!(former, "{refused}");
    }
    assert_eq!(kept(), before);
    assert_eq!(statement(dir), by_former);
}

#[test]
fn a_later_statement_includes_the_earlier_one() {
    let (dir, now_ms) = four_rounds();
    let dir = dir.path();
    let of = |rounds| Retention {
        rounds: Some(rounds),
        ..TWO_ROUNDS
    };
    let without_proofs = Retention {
        without_proofs: true,
        ..of(3)
    };
    prune(dir, &of(2), now_ms);
    let first = statement(dir);
    prune(dir, &without_proofs, now_ms);
    let second = statement(dir);
    assert_eq!(second.and(&first), second);
    assert_eq!((second.updates_before, second.proofs_before), (2, 1));
    prune(dir, &of(0), now_ms);
    let third = statement(dir);
    assert_eq!((third.updates_before, third.proofs_before), (4, 1));
    assert!(third.entries > second.entries);
    let (report, _) = audit(dir, Depth::Full);
    assert_eq!(faults(&report), [] as [&str; 0]);
}

#[test]
fn every_copy_of_the_log_says_what_was_pruned() {
    let (dir, now_ms) = four_rounds();
    let dir = dir.path();
    let scratch = tempfile::tempdir().unwrap();
    let at = |name: &str| scratch.path().join(name);
    // This mirror is older, and keeps what the log prunes later.
    follow(dir, &at("older")).unwrap();
    prune(dir, &TWO_ROUNDS, now_ms);
    let reported = statement(dir);
    export(&Publication::open(dir, None).unwrap(), &at("export")).unwrap();
    backup(dir, &at("backup")).unwrap();
    follow(&at("export"), &at("mirror")).unwrap();
    follow(dir, &at("older")).unwrap();
    for copy in ["backup", "mirror", "older"] {
        assert_eq!(statement(&at(copy)), reported, "{copy}");
        let (report, auditor) = audit(&at(copy), Depth::Full);
        assert_eq!(faults(&report), [] as [&str; 0], "{copy}");
        let pruned = left_out(&auditor, CheckKind::Updates);
        assert_eq!(pruned, if copy == "older" { 0 } else { 3 }, "{copy}");
    }
    // A source without the statement does not take it away.
    fs::remove_file(at("export").join("zk0/pruned")).unwrap();
    follow(&at("export"), &at("mirror")).unwrap();
    assert_eq!(statement(&at("mirror")), reported);
    // One that does not count is refused.
    fs::write(at("export").join("zk0/pruned"), b"pruned").unwrap();
    let refused = follow(&at("export"), &at("mirror"));
    assert!(is_wrong(&refused.unwrap_err()));
}

#[test]
fn an_export_that_is_being_updated_is_not_called_rolled_back() {
    let (dir, now_ms) = four_rounds();
    let dir = dir.path();
    let scratch = tempfile::tempdir().unwrap();
    let at = |name: &str| scratch.path().join(name);
    let (out, mirror) = (at("export"), at("mirror"));
    let publish = || export(&Publication::open(dir, None).unwrap(), &out).map(drop);
    prune(dir, &TWO_ROUNDS, now_ms);
    publish().unwrap();
    let size = Publication::open(dir, None).unwrap().checkpoint().size;
    let earlier = fs::read(out.join("checkpoint")).unwrap();
    // The next export has written its statement and not its checkpoint. Perhaps it was killed there.
    let later = Pruning {
        entries: size + 1,
        ..statement(dir)
    };
    fs::write(out.join("zk0/pruned"), signed(later, &log_key())).unwrap();
    for _ in 0..2 {
        let unfinished = follow(&out, &mirror).unwrap_err();
        assert!(!is_wrong(&unfinished), "{unfinished}");
        let words = format!(
            "is about {} entries, but the checkpoint is of {size}",
            size + 1
        );
        assert!(unfinished.to_string().contains(&words), "{unfinished}");
    }
    assert!(!mirror.join("pruned").exists());

    let mut operator = Operator {
        ledger: Ledger::open(dir, None, log_key()).unwrap(),
        time_ms: now_ms,
    };
    operator.append(Body::NodeEnrolled(NodeEnrolled {
        node: SigningNode::new(8).id(),
        name: "late".into(),
    }));
    assert_eq!(operator.ledger.size(), size + 1);
    drop(operator);
    write(dir, later, &log_key());
    publish().unwrap();
    follow(&out, &mirror).unwrap();
    assert_eq!(statement(&mirror), later);
    let (report, _) = audit(&mirror, Depth::Full);
    assert_eq!(faults(&report), [] as [&str; 0]);

    // A mirror that has more entries knows that the log is behind, whatever the statement is about.
    fs::write(out.join("checkpoint"), earlier).unwrap();
    let refused = follow(&out, &mirror).unwrap_err();
    assert!(!is_wrong(&refused), "{refused}");
    assert!(refused.to_string().contains("the log is behind"));
    // So does a state file, and that the log was rolled back when the time is over.
    let state = at("state");
    let audit_it = Audit {
        depth: Depth::Full,
        named: TrustedPrograms::default(),
        network: None,
        threads: None,
        state_file: Some(KeepState {
            path: state.clone(),
            every: Duration::from_secs(30),
        }),
        seen: None,
        behind_for: Duration::ZERO,
        fetch_again: None,
        progress: None,
    };
    assert!(audit_it.run(&mirror).unwrap().holds());
    let saved = SavedReplay::read(&state).unwrap().unwrap();
    let unfinished = follow(&out, &at("another")).unwrap_err();
    let unfinished = anyhow::Error::from(unfinished);
    let known = Some((state.as_path(), &saved));
    let within = |seconds| Shortfall::of(&unfinished, None, known, Duration::from_secs(seconds));
    let behind = LogBehind {
        shown: size,
        known: size + 1,
    };
    assert_eq!(within(3600), Some(Shortfall::Behind(behind)));
    let over = within(0);
    assert!(
        matches!(&over, Some(Shortfall::RolledBack(why)) if why.contains("ROLLED BACK")),
        "{over:?}"
    );

    // So does whoever audits a folder with such a statement.
    let beyond = Pruning {
        entries: size + 2,
        ..later
    };
    write(&mirror, beyond, &log_key());
    let (report, _) = audit(&mirror, Depth::Full);
    assert!(faults(&report)[0].contains("ROLLED BACK"));
    // And so does whoever would go on writing there.
    let refused = Ledger::open(&mirror, None, log_key()).map(drop);
    assert!(matches!(refused, Err(LedgerError::PrunedMore { .. })));
}
