//! A log that shows fewer entries than an audit has seen is behind. It was rolled back if it stays so.

use rocksdb::DB;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};
use tempfile::TempDir;
use zk0_audit::fetch::behind::{LogBehind, Shortfall};
use zk0_audit::fetch::{fetch, is_fault, WantedBlobs};
use zk0_audit::log_source::source;
use zk0_audit::run::{Audit, SeenLog};
use zk0_audit::{Depth, TrustedPrograms};
use zk0_ledger::published::export::export;
use zk0_ledger::published::publication::Publication;
use zk0_ledger::replay::{SaveOptions, Verdict};
use zk0_ledger::Ledger;
use zk0_protocol::entries::entry::Body;
use zk0_protocol::entries::member::NodeEnrolled;
use zk0_testkit::aggregator::operator::Operator;
use zk0_testkit::aggregator::*;

const HOUR: Duration = Duration::from_secs(3600);
const NO_TIME: Duration = Duration::ZERO;

/// A log, and an older copy of it with one entry less.
struct Scene {
    log: TempDir,
    older: TempDir,
    scratch: TempDir,
    behind: LogBehind,
}

impl Scene {
    fn new() -> Self {
        let log = tempfile::tempdir().unwrap();
        let founded = Operator::founds(log.path(), genesis(), &[&SigningNode::new(1)]);
        let (shown, time_ms) = (founded.ledger.size(), founded.time_ms);
        drop(founded);
        let older = copy_of(log.path());
        let mut operator = Operator {
            ledger: Ledger::open(log.path(), None, log_key()).unwrap(),
            time_ms,
        };
        operator.append(Body::NodeEnrolled(NodeEnrolled {
            node: SigningNode::new(2).id(),
            name: "late".into(),
        }));
        let known = operator.ledger.size();
        drop(operator);
        Self {
            log,
            older,
            scratch: tempfile::tempdir().unwrap(),
            behind: LogBehind { shown, known },
        }
    }

    fn place(&self, name: &str) -> PathBuf {
        self.scratch.path().join(name)
    }

    fn audit(&self, behind_for: Duration) -> Audit<'static> {
        Audit {
            depth: Depth::Full,
            named: TrustedPrograms::default(),
            network: None,
            threads: None,
            state_file: Some(SaveOptions {
                path: self.place("state"),
                every: HOUR,
            }),
            seen: None,
            behind_for,
            fetch_again: None,
            progress: None,
        }
    }
}

#[test]
fn a_log_behind_the_state_file_has_time_to_come_back() {
    let scene = Scene::new();
    let state = scene.place("state");
    assert!(scene.audit(HOUR).run(scene.log.path()).unwrap().holds());
    let kept = fs::read(&state).unwrap();
    let error = scene.audit(HOUR).run(scene.older.path()).unwrap_err();
    assert_eq!(error.downcast_ref::<LogBehind>(), Some(&scene.behind));
    assert!(!is_fault(&error));
    // The time is over.
    let report = scene.audit(NO_TIME).run(scene.older.path()).unwrap();
    assert_eq!(report.verdict, Verdict::Failed);
    let fault = &report.findings.last().unwrap().text;
    assert!(fault.contains("ROLLED BACK"), "{fault}");
    // What was seen stays, and the log goes on from there.
    assert_eq!(fs::read(&state).unwrap(), kept);
    assert!(scene.audit(NO_TIME).run(scene.log.path()).unwrap().holds());
}

#[test]
fn a_log_behind_what_the_caller_has_seen_has_time_to_come_back() {
    let scene = Scene::new();
    let report = scene.audit(HOUR).run(scene.log.path()).unwrap();
    fs::remove_file(scene.place("state")).unwrap();
    let seen = |behind_for| Audit {
        seen: Some(SeenLog {
            checkpoint: zk0_protocol::Checkpoint {
                size: report.entries,
                root: report.root.as_ref().unwrap().parse().unwrap(),
            },
            at: Instant::now(),
        }),
        ..scene.audit(behind_for)
    };
    let error = seen(HOUR).run(scene.older.path()).unwrap_err();
    assert_eq!(error.downcast_ref::<LogBehind>(), Some(&scene.behind));
    let report = seen(NO_TIME).run(scene.older.path()).unwrap();
    assert_eq!(report.verdict, Verdict::Failed);
}

#[test]
fn a_copy_that_the_log_has_not_signed_is_not_behind() {
    let scene = Scene::new();
    assert!(scene.audit(HOUR).run(scene.log.path()).unwrap().holds());
    let (checkpoint, size) = (scene.older.path().join("checkpoint"), scene.behind.shown);
    let mut forged = fs::read(&checkpoint).unwrap();
    let at = forged.len() - 5;
    forged[at] ^= 1;
    let mut key = vec![b'c'];
    key.extend(size.to_be_bytes());
    let db = DB::open_default(scene.older.path().join("log")).unwrap();
    db.put(key, &forged).unwrap();
    drop(db);
    fs::write(&checkpoint, forged).unwrap();
    let report = scene.audit(HOUR).run(scene.older.path()).unwrap();
    assert_eq!(report.verdict, Verdict::Failed);
}

#[test]
fn a_log_behind_its_mirror_has_time_to_come_back() {
    let scene = Scene::new();
    let (out, mirror) = (scene.place("export"), scene.place("mirror"));
    let follow = |from: &Path| {
        let source = source(from.to_str().unwrap(), None).unwrap();
        fetch(source.as_ref(), &mirror, None, None, WantedBlobs::Entries)
    };
    follow(scene.log.path()).unwrap();
    export(&Publication::open(scene.older.path(), None).unwrap(), &out).unwrap();
    let kept = fs::read(mirror.join("checkpoint")).unwrap();
    let error = anyhow::Error::from(follow(&out).unwrap_err());
    assert!(!is_fault(&error), "{error}");
    let within = |behind_for| Shortfall::of(&error, Some(&mirror), None, behind_for);
    assert_eq!(within(HOUR), Some(Shortfall::Behind(scene.behind)));
    assert!(
        matches!(within(NO_TIME), Some(Shortfall::RolledBack(why)) if why.starts_with("ROLLED BACK"))
    );
    assert_eq!(fs::read(mirror.join("checkpoint")).unwrap(), kept);
}
