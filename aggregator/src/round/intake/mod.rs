//! Recording what nodes, members and the operator send.

pub mod admission;
pub mod arrivals;
pub mod doomed;
pub mod group;
pub mod lost_files;
pub mod registrations;
pub mod staging;
pub mod statements;
pub mod submission;
