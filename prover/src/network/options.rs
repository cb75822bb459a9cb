//! How the network is asked.

use std::fmt;
use std::str::FromStr;
use std::time::Duration;

/// Who proves, by SP1's names.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ProverSelection {
    /// Provers of Succinct's network bid for a proof.
    #[default]
    Auction,
    /// A prover of Succinct's network under an agreement with the account.
    Reserved,
    /// Succinct's own provers, or a private SP1 cluster behind its network gateway.
    Hosted,
}

/// The text names no strategy.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("'{0}' is not a strategy of a prover network: write auction, reserved or hosted")]
pub struct UnknownStrategy(String);

impl FromStr for ProverSelection {
    type Err = UnknownStrategy;

    fn from_str(text: &str) -> Result<Self, UnknownStrategy> {
        match text {
            "auction" => Ok(Self::Auction),
            "reserved" => Ok(Self::Reserved),
            "hosted" => Ok(Self::Hosted),
            _ => Err(UnknownStrategy(text.into())),
        }
    }
}

impl fmt::Display for ProverSelection {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Auction => "auction",
            Self::Reserved => "reserved",
            Self::Hosted => "hosted",
        })
    }
}

/// How to ask the network.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NetworkOptions {
    /// Who proves.
    pub strategy: ProverSelection,
    /// The time-out of a proof.
    pub timeout: Duration,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_strategy_is_known_by_its_name() {
        for strategy in [
            ProverSelection::Auction,
            ProverSelection::Reserved,
            ProverSelection::Hosted,
        ] {
            assert_eq!(strategy.to_string().parse(), Ok(strategy));
        }
        let error = "cheap".parse::<ProverSelection>().unwrap_err();
        assert!(error.to_string().contains("'cheap'"), "{error}");
    }
}
