//! An operator denies that a contribution with a real proof verifies: it refuses the contribution, or upholds a dispute of it. The audit
//! finds both.

use crate::real_ledger::{accepted, ledger_copy};
use zk0_audit::checks::pruning_waiver::PruningWaiver;
use zk0_audit::checks::{disputed, Check, RecordedClaim};
use zk0_audit::Depth;
use zk0_ledger::blobs::Blobs;
use zk0_protocol::RefusalCode;

#[test]
fn a_good_contribution_that_was_refused_is_a_fault() {
    let dir = ledger_copy();
    let real = accepted(dir.path());
    let submission = real.contribution.submission;
    let recorded = RecordedClaim {
        index: real.index,
        time_ms: real.time_ms,
        context: (real.state).claim_context(&submission.statement.claim.terms.node),
        submission,
    };
    let blobs = Blobs::at(dir.path());
    for reason in [RefusalCode::InvalidProof, RefusalCode::MalformedUpdate] {
        match recorded.rejected(&reason, Depth::Full, PruningWaiver::default(), &blobs) {
            Check::Failed(why) => assert!(why.ends_with("nothing wrong with it"), "{why}"),
            found => panic!("not found: {found:?}"),
        }
    }
    // Nobody may refuse a contribution for what others can cause.
    let others = RefusalCode::NoVerifier;
    match recorded.rejected(&others, Depth::Full, PruningWaiver::default(), &blobs) {
        Check::Failed(why) => assert!(why.contains("not to blame"), "{why}"),
        found => panic!("not found: {found:?}"),
    }
}

#[test]
fn a_dispute_of_a_good_contribution_that_was_upheld_is_a_fault() {
    let upheld = RefusalCode::InvalidProof;
    match disputed(7, None, Some(&upheld)) {
        Check::Failed(why) => assert!(why.contains("the contribution verifies"), "{why}"),
        found => panic!("not found: {found:?}"),
    }
    assert!(matches!(disputed(7, None, None), Check::Passed(_)));
}
