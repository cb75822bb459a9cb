//! The tests of the readers.

mod datasets;
mod hub;
mod policy_folder;
