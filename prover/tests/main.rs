mod full_size;
mod guest;
mod not_provable;
#[cfg(feature = "network")]
mod prover_network;
mod service;
