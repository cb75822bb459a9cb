//! Proofs of mode `succinct` from Succinct's prover network or an SP1 cluster. Only the client needs the feature `network`.

mod account;
#[cfg(feature = "network")]
mod bid;
#[cfg(feature = "network")]
mod network_prover;
mod options;

pub use account::{AccountError, ProverAccount};
#[cfg(feature = "network")]
pub use network_prover::{NetworkError, NetworkProver};
pub use options::{NetworkOptions, ProverSelection, UnknownStrategy};
