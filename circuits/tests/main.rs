//! The tests of what is proven.

mod deletion;
mod fidelity;
mod lerobot_fixture;
mod overflow;
mod properties;
mod samples;
mod statement;
mod t_test;
mod vectors;
