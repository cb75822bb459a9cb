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
