//! Puts an update straight into the aggregator's store, at an address that the aggregator gives (HTTP, `PUT`).
//!
//! The node sends there what the aggregator gets anyway, and believes nothing that comes from there: whether the update has arrived, the
//! aggregator says. So the node looks only whether what it sends is as secret on its way as it is on the way to the aggregator.

use std::io::Read;
use std::sync::Arc;
use std::time::Duration;
use ureq::http::Uri;
use ureq::tls::{Certificate, RootCerts, TlsConfig};
use ureq::Agent;
use zk0_tls::authorities::{causes, Authorities};
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

/// Azure's stores ask which kind of object this is. The others ignore it.
const KIND: (&str, &str) = ("x-ms-blob-type", "BlockBlob");

/// Why an update cannot be put at an address.
#[derive(Debug, thiserror::Error)]
pub(super) enum StoreError {
    #[error("the aggregator gave something that is not the address of a store")]
    NoAddress,
    #[error("the aggregator's own connection is encrypted, and the address of its store, http://{0}, is not")]
    NotEncrypted(String),
    #[error("the store at {host} cannot be reached: {why}")]
    Unreachable { host: String, why: String },
    #[error("the store at {host} does not take the update: {why}")]
    Refused { host: String, why: String },
}

/// Puts updates into the store of an aggregator.
#[derive(Clone, Debug)]
pub(super) struct StoreClient {
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
    fn host(&self, address: &str) -> Result<String, StoreError> {
        if address.len() > MAX_ADDRESS_BYTES {
            return Err(StoreError::NoAddress);
        }
        let uri: Uri = address.parse().map_err(|_| StoreError::NoAddress)?;
        let authority = uri.authority().ok_or(StoreError::NoAddress)?;
        // An address may have a password before its host.
        let host = authority.as_str().rsplit('@').next().unwrap_or_default();
        match uri.scheme_str() {
            Some("https") => Ok(host.into()),
            Some("http") if !self.encrypted => Ok(host.into()),
            Some("http") => Err(StoreError::NotEncrypted(host.into())),
            _ => Err(StoreError::NoAddress),
        }
    }

    /// Puts the update at this address. Waits for the network.
    pub fn put(&self, address: &str, update: &Arc<[u8]>) -> Result<(), StoreError> {
        let host = self.host(address)?;
        let sent = self.agent().put(address).header(KIND.0, KIND.1);
        let mut answer = sent.send(&update[..]).map_err(|error| {
            let last = causes(&error).last().map(ToString::to_string);
            StoreError::Unreachable {
                host: host.clone(),
                why: one_line(&last.unwrap_or_else(|| error.to_string())),
            }
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
        Err(StoreError::Refused { host, why })
    }

    fn agent(&self) -> Agent {
        // A store has a certificate of a public authority, or of the one that the aggregator's operator runs.
        let system = Authorities::of_system("--ca").certificates();
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

/// Text of others in one short line, without characters that move the cursor.
fn one_line(text: &str) -> String {
    let shown = text.chars().map(|c| if c.is_control() { ' ' } else { c });
    let line: String = shown.take(SHOWN).collect();
    line.split_whitespace().collect::<Vec<_>>().join(" ")
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::{BufRead, BufReader, Write};
    use std::net::TcpListener;
    use std::thread::{self, JoinHandle};

    fn beside(aggregator: &str) -> StoreClient {
        StoreClient::beside(&ServiceAddress::from(aggregator.to_owned()))
    }

    fn plain() -> StoreClient {
        beside("http://zk0.example:1")
    }

    /// A store that takes one update and answers like this. Returns its address, and what it got: the head and the body.
    fn store(answer: String) -> (String, JoinHandle<(String, Vec<u8>)>) {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let address = format!("http://{}/a?signature=secret", listener.local_addr().unwrap());
        let got = thread::spawn(move || {
            let (mut stream, _) = listener.accept().unwrap();
            let mut reader = BufReader::new(stream.try_clone().unwrap());
            let (mut head, mut length) = (String::new(), 0);
            loop {
                let mut line = String::new();
                reader.read_line(&mut line).unwrap();
                if line.trim().is_empty() {
                    break;
                }
                let line = line.to_lowercase();
                if let Some(value) = line.strip_prefix("content-length:") {
                    length = value.trim().parse().unwrap();
                }
                head += &line;
            }
            let mut body = vec![0; length];
            reader.read_exact(&mut body).unwrap();
            // Who has read enough hangs up.
            let _ = stream.write_all(answer.as_bytes());
            (head, body)
        });
        (address, got)
    }

    fn answer(status: &str, more: &str, body: &str) -> String {
        let length = body.len();
        format!("HTTP/1.1 {status}\r\n{more}content-length: {length}\r\nconnection: close\r\n\r\n{body}")
    }

    fn refused(address: &str) -> String {
        let update = Arc::from(&b"update"[..]);
        plain().put(address, &update).unwrap_err().to_string()
    }

    #[test]
    fn the_whole_update_is_put_with_its_length() {
        let (address, got) = store(answer("200 OK", "", ""));
        let update: Arc<[u8]> = (0..300_000u32).map(|at| (at % 251) as u8).collect();
        plain().put(&address, &update).unwrap();
        let (head, body) = got.join().unwrap();
        assert!(head.starts_with("put /a?signature=secret http/1.1"), "{head}");
        assert!(head.contains("x-ms-blob-type: blockblob"), "{head}");
        assert!(!head.contains("transfer-encoding"), "{head}");
        assert!(body[..] == update[..]);
    }

    #[test]
    fn nobody_leads_the_node_elsewhere() {
        let elsewhere = TcpListener::bind("127.0.0.1:0").unwrap();
        elsewhere.set_nonblocking(true).unwrap();
        let location = format!("location: http://{}/b\r\n", elsewhere.local_addr().unwrap());
        for status in ["307 Temporary Redirect", "308 Permanent Redirect", "303 See Other"] {
            let (address, got) = store(answer(status, &location, ""));
            let said = refused(&address);
            assert!(said.contains(&status[..3]), "{said}");
            got.join().unwrap();
            let came = elsewhere.accept();
            assert!(came.is_err(), "{came:?}");
        }
    }

    #[test]
    fn an_answer_is_read_and_shown_in_part() {
        let long = "<Code>AccessDenied</Code>\u{1b}[31m\n".repeat(100_000);
        let (address, _) = store(answer("403 Forbidden", "", &long));
        let said = refused(&address);
        assert!(said.contains("403"), "{said}");
        assert!(said.contains("<Code>AccessDenied</Code>"), "{said}");
        assert!(said.len() < 400, "{said}");
        assert!(!said.contains(|c: char| c.is_control()), "{said:?}");
        assert!(!said.contains("secret"), "{said}");
    }

    #[test]
    fn a_store_that_is_not_there_is_named_without_the_signature() {
        let free = TcpListener::bind("127.0.0.1:0").unwrap();
        let host = free.local_addr().unwrap().to_string();
        drop(free);
        let said = refused(&format!("http://{host}/a?signature=secret"));
        assert!(said.contains(&format!("the store at {host} cannot be reached")), "{said}");
        assert!(!said.contains("secret"), "{said}");
    }

    #[test]
    fn an_update_goes_to_an_encrypted_store_unless_the_aggregator_is_not_encrypted_either() {
        let (encrypted, plain) = (beside("https://zk0.example:1"), plain());
        let (https, http) = ("https://s3.example/a?b=c", "http://s3.example:9000/a?b=c");
        for client in [&encrypted, &plain] {
            assert_eq!(client.host(https).unwrap(), "s3.example");
        }
        assert_eq!(plain.host(http).unwrap(), "s3.example:9000");
        let refused = encrypted.host(http).unwrap_err().to_string();
        assert!(
            refused.contains("http://s3.example:9000, is not"),
            "{refused}"
        );
        assert!(!refused.contains("b=c"), "{refused}");
    }

    #[test]
    fn what_is_no_address_of_http_is_refused() {
        let client = plain();
        let long = format!("https://s3.example/{}", "a".repeat(MAX_ADDRESS_BYTES));
        for address in ["", "s3.example", "/a", "ftp://s3.example/a", "file:///etc/passwd", &long] {
            let refused = client.host(address);
            assert!(matches!(refused, Err(StoreError::NoAddress)), "{address}");
        }
        let host = client.host("https://user:secret@s3.example/a").unwrap();
        assert_eq!(host, "s3.example");
    }
}
