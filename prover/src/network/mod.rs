//! Has claims of mode `succinct` proven elsewhere: by Succinct's prover network, or by an SP1 cluster. What asks them is behind the feature
//! `network`. Everything else is in every build.

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
