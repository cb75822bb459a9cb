//! The machine of an aggregator is lost at each step of a round, with the ledger's folder. Another one goes on from the bucket, with the log's key
//! and an empty folder. Every receipt stays what it was, and the round closes as it was recorded.

use super::accepting::Served;
use crate::harness::drill::Drill;
use crate::pages::Reader;
use zk0_testkit::s3::S3;

fn goes_on_elsewhere(step: &str) {
    let Some(s3) = S3::start() else { return };
    let mut drill = Drill::begin("the machine is lost, with a bucket");
    let serve = "zk0 aggregator serve ledger --key log.key --blob-store";
    drill.typed = vec![Reader::on_page("docs/runbook.md", serve)];
    Served::start_in(Some(s3)).goes_on(step, 1);
    drill.passed();
}

#[test]
fn the_machine_is_lost_when_an_update_is_committed() {
    goes_on_elsewhere("update committed");
}

#[test]
fn the_machine_is_lost_when_the_commitments_are_closed() {
    goes_on_elsewhere("commitments closed");
}

#[test]
fn the_machine_is_lost_when_the_randomness_is_drawn() {
    goes_on_elsewhere("randomness drawn");
}

#[test]
fn the_machine_is_lost_when_a_contribution_is_accepted() {
    goes_on_elsewhere("contribution accepted");
}

#[test]
fn the_machine_is_lost_when_the_round_has_closed() {
    goes_on_elsewhere("round closed");
}
