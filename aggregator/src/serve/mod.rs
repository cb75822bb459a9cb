//! The gRPC service in front of the rounds.

pub mod beacon_fetching;
mod blob_store;
pub mod federation_service;
mod grpc;
mod health;
mod in_turn;
pub mod limits;
mod recorder;
mod senders;
pub mod service;
mod stepping;
mod submitting;
mod uploading;
mod uploads;
mod watching;
