//! A round leaves out an accepted contribution, because the aggregator has lost a file of it. Nothing rests on it, and an audit reports it.

use std::fs;
use zk0_audit::{Auditor, Depth};
use zk0_ledger::replay::{replay, Verdict};
use zk0_protocol::entries::entry::{Body, LostContribution};
use zk0_testkit::aggregator::operator::Operator;
use zk0_testkit::aggregator::*;
use zk0_verifier::blob_digest;

#[test]
fn an_audit_reports_what_was_left_out_and_needs_no_file_of_it() {
    for left_out in [false, true] {
        let dir = tempfile::tempdir().unwrap();
        let node = SigningNode::new(1);
        let mut operator = Operator::founds(dir.path(), genesis(), &[&node]);
        operator.open();
        // Nothing but an audit of this file could find that it proves nothing.
        let submission = operator.submission(&node, 1, b"a proof");
        operator.append(Body::ContributionAccepted(submission));
        for file in [&weights(1)[..], b"a proof"] {
            let path = operator.ledger.blobs().path(&blob_digest(file));
            fs::remove_file(path).unwrap();
        }
        if left_out {
            let (round, node) = (0, node.id());
            let lost = LostContribution { round, node };
            operator.append(Body::FilesLost(lost));
            operator.time_ms += operator.state().rules().submit_window_ms;
            operator.append(Body::ContributionLeftOut(lost));
        }
        operator.close(0);
        drop(operator);
        for depth in [Depth::Light, Depth::Full] {
            let report = replay(dir.path(), None, &mut Auditor::new(depth));
            let mut findings = report.findings.iter();
            let reported = findings.any(|one| one.text.contains("round 0 leaves out"));
            assert_eq!(reported, left_out);
            let failed = report.verdict == Verdict::Failed;
            assert_eq!(failed, !left_out, "{:?}", report.findings);
        }
    }
}
