//! The gRPC service in front of the rounds.

pub mod beacon_fetching;
mod grpc;
mod health;
pub mod limits;
pub mod requests;
pub mod service;
mod signed_by;
mod upload_places;
