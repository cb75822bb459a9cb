//! The gRPC service in front of the rounds.

pub mod beacon_fetching;
mod blob_store;
mod grpc;
mod health;
mod in_turn;
pub mod limits;
mod node_turns;
mod recorder;
pub mod requests;
mod senders;
pub mod service;
mod stepping;
mod submitting;
mod uploading;
mod uploads;
mod watching;
