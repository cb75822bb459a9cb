//! The gRPC service in front of the rounds.

mod blob_store;
mod driver;
pub mod federation_service;
mod grpc;
mod health;
mod in_turn;
pub mod limits;
mod pruning;
mod publishing;
mod recorder;
mod senders;
pub mod service;
mod submitting;
mod uploading;
mod uploads;
mod watching;
