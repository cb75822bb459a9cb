//! A served aggregator, as nodes, operators and witnesses see it. These tests are one program, because compiling the client and the network that they
//! share takes longer than the tests.

#[path = "../../../protocol/tests/network/beacon.rs"]
mod beacon;
#[path = "../harness/mod.rs"]
mod harness;

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
