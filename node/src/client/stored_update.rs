//! Puts an update straight into the aggregator's store, at an address that the aggregator gives (HTTP, `PUT`).
//!
//! The node sends there what the aggregator gets anyway, and believes nothing that comes from there: whether the update has arrived, the
//! aggregator says. So the node looks only whether what it sends is as secret on its way as it is on the way to the aggregator.

use std::io::Read;
use std::time::Duration;
use ureq::http::Uri;
use ureq::tls::{Certificate, RootCerts, TlsConfig};
use ureq::Agent;
use zk0_tls::authorities::{causes, tls_error, Authorities};
use zk0_tls::service_address::ServiceAddress;

/// Longest address that is used.
const MAX_ADDRESS_BYTES: usize = 8 << 10;

/// How long a connection may take. A network that does not let the node through is often silent.
const CONNECTING: Duration = Duration::from_secs(10);

/// How long the store may take nothing of the update, or may take until it answers.
const SILENCE: Duration = Duration::from_secs(60);

/// How long all of it may take.
const LONGEST: Duration = Duration::from_secs(3600);

/// How much of a store's answer is read, in bytes.
const MAX_ANSWER_BYTES: u64 = 2 << 10;

/// How much of it is shown, in characters.
const SHOWN: usize = 200;

/// The option that names other authorities.
const CA: &str = "--ca";

/// Azure's stores ask which kind of object this is. The others ignore it.
const KIND: (&str, &str) = ("x-ms-blob-type", "BlockBlob");

/// A store that refuses the update says so before the node sends hundreds of megabytes. If it does not know this header, the node sends them
/// after a second.
const FIRST_ASK: (&str, &str) = ("expect", "100-continue");

/// Why an update cannot be put at an address.
#[derive(Debug, thiserror::Error)]
pub enum StoredUpdateError {
    /// The text is not an address of HTTP.
    #[error("the aggregator gave something that is not the address of a store")]
    NoAddress,
    /// What travels to the address is not encrypted, and what travels to the aggregator is.
    #[error("the aggregator's own connection is encrypted, and the address of its store, http://{0}, is not")]
    NotEncrypted(String),
    /// Nobody answers, or whoever answers does not show the right certificate.
    #[error("the store at {host} cannot be reached: {why}")]
    Unreachable {
        /// Its host.
        host: String,
        /// What is wrong.
        why: String,
    },
    /// The store answers that it does not take it.
    #[error("the store at {host} does not take the update: {why}")]
    Refused {
        /// Its host.
        host: String,
        /// What it answered.
        why: String,
    },
}

/// Puts updates into the store of an aggregator.
#[derive(Clone, Debug)]
pub struct StoreClient {
    /// Whether the connection to the aggregator is encrypted.
    encrypted: bool,
    /// Whose certificates count for the aggregator.
    authorities: Authorities,
}

impl StoreClient {
    /// A client for the store of the aggregator at `address`.
    pub fn beside(address: &ServiceAddress) -> Self {
        Self {
            encrypted: address.is_encrypted(),
            authorities: address.authorities().clone(),
        }
    }

    /// The host in an address at which an update may be put.
    fn host(&self, address: &str) -> Result<String, StoredUpdateError> {
        if address.len() > MAX_ADDRESS_BYTES {
            return Err(StoredUpdateError::NoAddress);
        }
        let uri: Uri = address.parse().map_err(|_| StoredUpdateError::NoAddress)?;
        let authority = uri.authority().ok_or(StoredUpdateError::NoAddress)?;
        // An address may have a password before its host.
        let host = authority.as_str().rsplit('@').next().unwrap_or_default();
        match uri.scheme_str() {
            Some("https") => Ok(host.into()),
            Some("http") if !self.encrypted => Ok(host.into()),
            Some("http") => Err(StoredUpdateError::NotEncrypted(host.into())),
            _ => Err(StoredUpdateError::NoAddress),
        }
    }

    /// Puts the update at this address. Waits for the network.
    pub fn put(&self, address: &str, update: &[u8]) -> Result<(), StoredUpdateError> {
        let host = self.host(address)?;
        let sent = self.agent().put(address);
        let sent = [KIND, FIRST_ASK]
            .into_iter()
            .fold(sent, |sent, (name, value)| sent.header(name, value));
        let mut answer = sent
            .send(update)
            .map_err(|error| StoredUpdateError::Unreachable {
                host: host.clone(),
                why: one_line(&why(&error)),
            })?;
        if answer.status().is_success() {
            return Ok(());
        }
        let mut said = Vec::new();
        // What cannot be read is not shown.
        let _ = answer
            .body_mut()
            .as_reader()
            .take(MAX_ANSWER_BYTES)
            .read_to_end(&mut said);
        let said = one_line(&String::from_utf8_lossy(&said));
        let why = format!("{} {said}", answer.status());
        Err(StoredUpdateError::Refused { host, why })
    }

    fn agent(&self) -> Agent {
        // A store has a certificate of a public authority, or of the one that the aggregator's operator runs.
        let system = Authorities::of_system(CA).certificates();
        let own = match self.authorities.file() {
            Some(_) => self.authorities.certificates(),
            None => Ok(Vec::new()),
        };
        let roots: Vec<_> = [system, own]
            .into_iter()
            .flatten()
            .flatten()
            .map(|der| Certificate::from_der(&der).to_owned())
            .collect();
        let tls = TlsConfig::builder()
            .root_certs(RootCerts::from(roots))
            .build();
        let config = Agent::config_builder()
            .tls_config(tls)
            // Nobody leads the node elsewhere.
            .max_redirects(0)
            // An answer with an error status is an answer, and not an error of the client.
            .http_status_as_error(false)
            .timeout_global(Some(LONGEST))
            .timeout_connect(Some(CONNECTING))
            .timeout_per_write(Some(SILENCE))
            .timeout_recv_response(Some(SILENCE))
            .timeout_recv_body(Some(CONNECTING));
        config.build().into()
    }
}

/// Why there is no answer.
fn why(error: &ureq::Error) -> String {
    let of_tls = match error {
        ureq::Error::Rustls(error) => Some(error),
        ureq::Error::Io(error) => tls_error(error),
        _ => None,
    };
    match of_tls {
        Some(error) => Authorities::of_system(CA).meaning(error),
        None => causes(error)
            .last()
            .map_or_else(|| error.to_string(), ToString::to_string),
    }
}

/// Text of others in one short line, without characters that move the cursor.
fn one_line(text: &str) -> String {
    let shown = text.chars().map(|c| if c.is_control() { ' ' } else { c });
    let line: String = shown.take(SHOWN).collect();
    line.split_whitespace().collect::<Vec<_>>().join(" ")
}
