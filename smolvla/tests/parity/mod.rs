//! The policy in candle against LeRobot's own values, within the tolerances of the fixture's README.
//!
//! The reference is `tests/fixtures/smolvla_tiny`, or another folder of the same layout in `ZK0_PARITY_DIR`: of any dimensions,
//! cameras and batch. Nothing here knows a size that is not read from its files.

mod acting;
mod case;
mod epsilon;
mod expert;
mod gradients;
mod other_folder;
mod prefix;
mod sampling;
mod steps;
mod training;
mod units;
mod without_kernels;
