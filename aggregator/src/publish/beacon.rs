//! Fetches a beacon of drand over HTTP (`/{chain}/public/{round}`), from one of several servers. None is trusted: the beacon's signature
//! must verify with the public key in the rules.

use serde::Deserialize;
use std::time::Duration;
use zk0_ledger::published::http_client::{HttpClient, HttpError};
use zk0_protocol::challenge::drand::{BeaconSignature, DrandChain};
use zk0_protocol::quote::short;

/// Default of [`BeaconServers::retry`].
const RETRY: Duration = Duration::from_secs(2);

const PUBLIC_SERVERS: [&str; 3] = [
    "https://api.drand.sh",
    "https://api2.drand.sh",
    "https://drand.cloudflare.com",
];

/// Largest answer that is read, in bytes.
const MAX_ANSWER_BYTES: u64 = 4 << 10;

/// The servers, asked one after the other.
#[derive(Clone, Debug)]
pub struct BeaconServers {
    urls: Vec<String>,
    client: HttpClient,
    retry: Duration,
}

/// Why a server's answer does not help.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ServerError {
    /// No answer, or not in time.
    #[error("it cannot be reached: {0}")]
    Down(String),
    /// The beacon is not there yet.
    #[error("it does not have round {0} yet, although the time of that round has come: it is late, or this machine's clock is fast")]
    Late(u64),
    /// The chain is unknown.
    #[error("it does not serve the chain {0} that the rules name")]
    NoChain(String),
    /// Another chain has the name of this one.
    #[error(
        "it serves another chain: its public key is {found}, but the rules name the key {expected}"
    )]
    OtherChain { found: String, expected: String },
    /// The server fails.
    #[error("it answers with status {0}")]
    Status(u16),
    /// The answer is not a beacon.
    #[error("its answer is not a beacon: {0}")]
    Malformed(String),
    /// The beacon is of another round.
    #[error("it answers with the beacon of round {found}; round {asked} was asked for")]
    OtherRound { found: u64, asked: u64 },
    /// The signature of the beacon is wrong.
    #[error("the signature of its beacon of round {0} is wrong")]
    Signature(u64),
}

/// No server has the beacon.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("no server has given the beacon of drand round {round}. {}", reported(.errors))]
pub struct NoBeacon {
    /// The beacon's round.
    pub round: u64,
    /// The error of each server.
    pub errors: Vec<(String, ServerError)>,
}

fn reported(errors: &[(String, ServerError)]) -> String {
    let each = errors.iter().map(|(url, error)| format!("{url}: {error}"));
    each.collect::<Vec<_>>().join("; ")
}

#[derive(Deserialize)]
struct DrandBeacon {
    round: u64,
    signature: String,
}

#[derive(Deserialize)]
struct ChainInfo {
    public_key: String,
}

impl BeaconServers {
    /// Servers, each with `patience` to answer.
    pub fn new(urls: Vec<String>, patience: Duration) -> Self {
        let trimmed = urls.iter().map(|url| url.trim_end_matches('/').to_owned());
        Self {
            urls: trimmed.collect(),
            client: HttpClient::of_system("SSL_CERT_FILE", patience),
            retry: RETRY,
        }
    }

    /// Sets the pause when no server had the beacon, by default two seconds.
    pub fn retrying_after(mut self, retry: Duration) -> Self {
        self.retry = retry;
        self
    }

    /// The pause when no server had the beacon.
    pub fn retry(&self) -> Duration {
        self.retry
    }

    /// The public servers of drand's "quicknet".
    pub fn public(patience: Duration) -> Self {
        Self::new(PUBLIC_SERVERS.map(str::to_owned).to_vec(), patience)
    }

    /// The signature of a round of `chain`, from the first server that has it.
    pub fn fetch(&self, chain: &DrandChain, round: u64) -> Result<BeaconSignature, NoBeacon> {
        let mut errors = Vec::new();
        for url in &self.urls {
            match self.ask(url, chain, round) {
                Ok(signature) => return Ok(signature),
                Err(error) => errors.push((url.clone(), error)),
            }
        }
        Err(NoBeacon { round, errors })
    }

    fn ask(
        &self,
        url: &str,
        chain: &DrandChain,
        round: u64,
    ) -> Result<BeaconSignature, ServerError> {
        let name = hex::encode(chain.hash);
        let (status, body) = self.get(&format!("{url}/{name}/public/{round}"))?;
        match status {
            200 => {}
            // Servers answer so for a future round, and for an unknown chain.
            404 | 425 => {
                self.check_chain(url, chain)?;
                return Err(ServerError::Late(round));
            }
            status => return Err(ServerError::Status(status)),
        }
        let beacon: DrandBeacon = read(&body)?;
        if beacon.round != round {
            return Err(ServerError::OtherRound {
                found: beacon.round,
                asked: round,
            });
        }
        let mut signature: BeaconSignature = [0; 48];
        hex::decode_to_slice(&beacon.signature, &mut signature).map_err(|error| {
            let quoted = short(&beacon.signature);
            ServerError::Malformed(format!("the signature '{quoted}': {error}"))
        })?;
        if chain.signed(round, &signature) {
            return Ok(signature);
        }
        self.check_chain(url, chain)?;
        Err(ServerError::Signature(round))
    }

    fn check_chain(&self, url: &str, chain: &DrandChain) -> Result<(), ServerError> {
        let name = hex::encode(chain.hash);
        let (status, body) = self.get(&format!("{url}/{name}/info"))?;
        match status {
            200 => {}
            404 => return Err(ServerError::NoChain(name)),
            status => return Err(ServerError::Status(status)),
        }
        let (found, expected) = (
            read::<ChainInfo>(&body)?.public_key,
            hex::encode(chain.public_key),
        );
        if found == expected {
            Ok(())
        } else {
            Err(ServerError::OtherChain {
                found: short(&found),
                expected,
            })
        }
    }

    fn get(&self, url: &str) -> Result<(u16, Vec<u8>), ServerError> {
        let down = |error: HttpError| ServerError::Down(error.to_string());
        let mut response = self.client.get(url).map_err(down)?;
        let body = response.body_mut().with_config().limit(MAX_ANSWER_BYTES);
        let body = body.read_to_vec();
        let body = body.map_err(|error| down(self.client.why(&error)))?;
        Ok((response.status().as_u16(), body))
    }
}

fn read<'a, T: Deserialize<'a>>(body: &'a [u8]) -> Result<T, ServerError> {
    serde_json::from_slice(body).map_err(|error| ServerError::Malformed(error.to_string()))
}
