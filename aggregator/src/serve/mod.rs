//! The gRPC service in front of the rounds.

pub mod connections;
pub mod governance_info;
pub mod service;
