//! The gRPC service in front of the rounds.

pub mod beacon_fetching;
pub mod requests;
pub mod service;
mod upload_places;
