//! A served aggregator, as nodes, operators and witnesses see it.

mod beacons;
mod clock;
mod enrolment;
mod governance;
mod in_time;
mod limits;
mod lost_files;
mod programs;
mod public_samples;
mod publishing;
mod refusals;
mod rounds;
mod witnessed_randomness;
mod witnessing;

use std::error::Error;
use zk0_aggregator::{Aggregator, Polled, RoundStep};
use zk0_protocol::entries::entry::Body;
use zk0_protocol::entries::signed::{Dispute, Evidence, Signed};
use zk0_protocol::RefusalCode;
use zk0_testkit::aggregator::*;

/// A governor disputes the contribution of this entry, and the aggregator verifies it again. Returns what the ledger then holds against it.
fn verified_again(
    aggregator: &mut Aggregator,
    contribution: u64,
) -> Result<Option<RefusalCode>, Box<dyn Error>> {
    let governor = SigningNode::new(GOVERNOR);
    let dispute = Dispute {
        network: *aggregator.state().network(),
        disputer: governor.id(),
        contribution,
        evidence: Evidence::Verification,
    };
    let body = Body::Disputed(Signed::new(dispute, &governor.key));
    let entry = aggregator.tell(&borsh::to_vec(&body)?)?.index;
    assert_eq!(aggregator.go_on()?, Polled::Did(RoundStep::Resolve(entry)));
    let Body::DisputeResolved(resolved) = aggregator.ledger().entry(entry + 1)?.body else {
        panic!("the dispute is not resolved");
    };
    assert_eq!(resolved.dispute, entry);
    assert_eq!(aggregator.ledger().size(), entry + 2);
    Ok(resolved.upheld)
}
