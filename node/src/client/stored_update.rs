//! Puts an update into the aggregator's store by HTTP `PUT`, at an address that the aggregator gives.
//!
//! The node sends only what the aggregator gets anyway, and trusts no answer of the store: the aggregator tells whether the update has
//! arrived. So the node checks only that the way there is as secret as the way to the aggregator.

use std::io::Read;
use std::time::Duration;
use ureq::http::Uri;
use ureq::tls::{Certificate, RootCerts, TlsConfig};
use ureq::Agent;
use zk0_service::tls::authorities::{causes, tls_error, Authorities};
use zk0_service::tls::service_address::ServiceAddress;

const MAX_ADDRESS_BYTES: usize = 8 << 10;

/// A network that blocks the node often gives no answer.
const CONNECTING: Duration = Duration::from_secs(10);

/// Limit for a store that takes no byte, or gives no answer.
const SILENCE: Duration = Duration::from_secs(60);

/// Limit for the whole `PUT`.
const LONGEST: Duration = Duration::from_secs(3600);

/// Bytes of the store's answer that are read.
const MAX_ANSWER_BYTES: u64 = 2 << 10;

/// Characters of it that are shown.
const SHOWN: usize = 200;

const CA: &str = "--ca";

/// Azure's stores require it. Others ignore it.
const KIND: (&str, &str) = ("x-ms-blob-type", "BlockBlob");

/// Lets a store refuse the update before hundreds of megabytes are sent. If it does not know this header, the node sends them after a
/// second.
const FIRST_ASK: (&str, &str) = ("expect", "100-continue");

/// Why an update cannot be put at an address.
#[derive(Debug, thiserror::Error)]
pub enum StoredUpdateError {
    /// The text is not an HTTP address.
    #[error("the aggregator gave something that is not the address of a store")]
    NoAddress,
    /// The connection to the aggregator is encrypted, and the one to the store is not.
    #[error("the aggregator's own connection is encrypted, and the address of its store, http://{0}, is not")]
    NotEncrypted(String),
    /// No answer, or a wrong certificate.
    #[error("the store at {host} cannot be reached: {why}")]
    Unreachable {
        /// Its host.
        host: String,
        /// What is wrong.
        why: String,
    },
    /// The store refuses the update.
    #[error("the store at {host} does not take the update: {why}")]
    Refused {
        /// Its host.
        host: String,
        /// Its answer.
        why: String,
    },
}

/// Puts updates into an aggregator's store.
#[derive(Clone, Debug)]
pub struct StoreClient {
    encrypted: bool,
    /// For the aggregator's certificate.
    authorities: Authorities,
}

impl StoreClient {
    /// A client for the aggregator's store.
    pub fn beside(address: &ServiceAddress) -> Self {
        Self {
            encrypted: address.is_encrypted(),
            authorities: address.authorities().clone(),
        }
    }

    /// The host, if the address is allowed.
    fn host(&self, address: &str) -> Result<String, StoredUpdateError> {
        if address.len() > MAX_ADDRESS_BYTES {
            return Err(StoredUpdateError::NoAddress);
        }
        let uri: Uri = address.parse().map_err(|_| StoredUpdateError::NoAddress)?;
        let authority = uri.authority().ok_or(StoredUpdateError::NoAddress)?;
        // A password may come before the host.
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
        let mut reported = Vec::new();
        let _ = answer
            .body_mut()
            .as_reader()
            .take(MAX_ANSWER_BYTES)
            .read_to_end(&mut reported);
        let reported = one_line(&String::from_utf8_lossy(&reported));
        let why = format!("{} {reported}", answer.status());
        Err(StoredUpdateError::Refused { host, why })
    }

    fn agent(&self) -> Agent {
        // The certificate is of a public authority or the operator's own.
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
            // No store may redirect the node.
            .max_redirects(0)
            // An error status is an answer, too.
            .http_status_as_error(false)
            .timeout_global(Some(LONGEST))
            .timeout_connect(Some(CONNECTING))
            .timeout_per_write(Some(SILENCE))
            .timeout_recv_response(Some(SILENCE))
            .timeout_recv_body(Some(CONNECTING));
        config.build().into()
    }
}

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

/// Text of others in one line, without characters that move the cursor.
fn one_line(text: &str) -> String {
    let shown = text.chars().map(|c| if c.is_control() { ' ' } else { c });
    let line: String = shown.take(SHOWN).collect();
    line.split_whitespace().collect::<Vec<_>>().join(" ")
}
