//! The account and the address of the network, from SP1's environment variables.

use std::env::{self, VarError};
use tonic::transport::Uri;

const KEY: &str = "NETWORK_PRIVATE_KEY";
const ADDRESS: &str = "NETWORK_RPC_URL";

/// The account and the address. Without `Debug`, so that no log can show the key.
#[derive(Clone, PartialEq, Eq)]
pub struct ProverAccount {
    key: String,
    address: Option<String>,
}

/// Why there is no account.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum AccountError {
    /// There is no key.
    #[error(
        "the environment variable NETWORK_PRIVATE_KEY is not set: it has to hold the private key of your account on the prover network, \
         which are 64 hexadecimal digits"
    )]
    NoKey,
    /// Not a key. The error does not show the text.
    #[error("NETWORK_PRIVATE_KEY is not a private key of 64 hexadecimal digits, with or without 0x in front: {0}")]
    NotAKey(String),
    /// Not an address.
    #[error("NETWORK_RPC_URL is not an address such as https://HOST or http://HOST:PORT: '{text}' {why}")]
    NotAnAddress {
        /// The text.
        text: String,
        /// What is wrong.
        why: String,
    },
}

impl ProverAccount {
    /// Reads `NETWORK_PRIVATE_KEY` and `NETWORK_RPC_URL`.
    pub fn from_environment() -> Result<Self, AccountError> {
        let variable = |name| match env::var(name) {
            Ok(text) if text.is_empty() => Ok(None),
            Ok(text) => Ok(Some(text)),
            Err(VarError::NotPresent) => Ok(None),
            Err(VarError::NotUnicode(_)) => Err("it is not text"),
        };
        let key = variable(KEY).map_err(|why| AccountError::NotAKey(why.into()))?;
        let address = variable(ADDRESS).map_err(|why| AccountError::NotAnAddress {
            text: String::new(),
            why: why.into(),
        })?;
        Self::new(key, address)
    }

    /// Checks both. The default address is Succinct's for the strategy.
    pub fn new(key: Option<String>, address: Option<String>) -> Result<Self, AccountError> {
        let key = key.ok_or(AccountError::NoKey)?;
        let digits = key.strip_prefix("0x").unwrap_or(&key);
        let other = digits
            .chars()
            .position(|digit| !digit.is_ascii_hexdigit())
            .map(|at| format!("character {} of it is no hexadecimal digit", at + 1));
        if let Some(why) = other {
            return Err(AccountError::NotAKey(why));
        }
        if digits.len() != 64 {
            let why = format!("it has {} digits", digits.len());
            return Err(AccountError::NotAKey(why));
        }
        if let Some(text) = &address {
            check_address(text).map_err(|why| AccountError::NotAnAddress {
                text: text.clone(),
                why,
            })?;
        }
        Ok(Self { key, address })
    }

    /// The private key.
    #[cfg(feature = "network")]
    pub(super) fn key(&self) -> &str {
        &self.key
    }

    /// The address, if set.
    #[cfg(feature = "network")]
    pub(super) fn address(&self) -> Option<&str> {
        self.address.as_deref()
    }
}

/// Whether gRPC can use the address.
fn check_address(text: &str) -> Result<(), String> {
    let uri: Uri = text.parse().map_err(|error| format!("({error})"))?;
    if !matches!(uri.scheme_str(), Some("http" | "https")) {
        return Err("does not begin with http:// or https://".into());
    }
    if uri.host().is_none_or(str::is_empty) {
        return Err("names no host".into());
    }
    // gRPC would silently omit the path.
    if uri.path() != "/" || uri.query().is_some() {
        return Err("has a path behind the host".into());
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn refusal(key: Option<&str>, address: Option<&str>) -> String {
        match ProverAccount::new(key.map(Into::into), address.map(Into::into)) {
            Ok(_) => panic!("accepted"),
            Err(error) => error.to_string(),
        }
    }

    #[test]
    fn a_key_has_64_hexadecimal_digits() {
        let key = "0123456789abcdef".repeat(4);
        for key in [key.clone(), format!("0x{}", key.to_uppercase())] {
            assert!(ProverAccount::new(Some(key), None).is_ok());
        }
        assert!(refusal(None, None).contains("NETWORK_PRIVATE_KEY is not set"));
        assert!(refusal(Some("0x12"), None).contains("it has 2 digits"));
        let secret = format!("{}z", &key[1..]);
        let error = refusal(Some(&secret), None);
        assert!(error.contains("character 64"), "{error}");
        assert!(!error.contains(&secret[..8]), "it shows the key: {error}");
    }

    #[test]
    fn an_address_has_a_scheme_and_a_host_alone() {
        let key = "1".repeat(64);
        for address in ["https://rpc.example.org", "http://127.0.0.1:50051/"] {
            assert!(ProverAccount::new(Some(key.clone()), Some(address.into())).is_ok());
        }
        for (address, why) in [
            ("my cluster", "invalid uri"),
            ("rpc.example.org:443", "does not begin with http"),
            ("ftp://rpc.example.org", "does not begin with http"),
            ("https://rpc.example.org/v1", "has a path"),
        ] {
            let error = refusal(Some(&key), Some(address));
            assert!(error.contains(why) && error.contains(address), "{error}");
        }
    }
}
