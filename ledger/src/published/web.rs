//! A published log, read over HTTP.

use crate::published::http_client::HttpClient;
use crate::published::source::{LogSource, SourceError};
use crate::published::web_file::WebFile;
use std::io::Read;
use std::path::Path;
use std::sync::atomic::AtomicBool;
use std::time::Duration;
use zk0_service::tls::authorities::Authorities;

/// How long a server may be silent. It may have to fetch the file from a bucket.
const SILENCE: Duration = Duration::from_secs(120);

/// A log served under an address.
pub struct Web {
    client: HttpClient,
    base: String,
    /// Whether the server has ever answered.
    answered: AtomicBool,
}

impl Web {
    /// The log under `url`, such as `https://host/log`. Fetches nothing. Trusts only the authorities in the PEM file `ca`, or else the
    /// system's.
    ///
    /// # Errors
    /// The address is invalid, or not encrypted despite `ca`; or the file holds no certificate.
    pub fn at(url: &str, ca: Option<&Path>) -> Result<Self, SourceError> {
        let encrypted = url.starts_with("https://");
        if !(encrypted || url.starts_with("http://")) {
            let why = "this is not an address that begins with http:// or https://".into();
            return Err(SourceError::new(url, why));
        }
        if ca.is_some() && !encrypted {
            let why = "there is no certificate to check with --ca: use https://".into();
            return Err(SourceError::new(url, why));
        }
        let authorities = Authorities::of_system("--ca").in_file(ca.map(Into::into));
        let client = HttpClient::for_files(authorities, SILENCE);
        Ok(Self {
            client: client.map_err(|error| SourceError::new(url, error.to_string()))?,
            base: url.trim_end_matches('/').into(),
            answered: AtomicBool::new(false),
        })
    }
}

impl LogSource for Web {
    fn open(&self, path: &str) -> Result<Option<Box<dyn Read>>, SourceError> {
        let url = format!("{}/{path}", self.base);
        let file = WebFile::open(self.client.clone(), url.clone(), &self.answered)
            .map_err(|error| SourceError::new(&url, error.to_string()))?;
        Ok(file.map(|file| Box::new(file) as Box<dyn Read>))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Write;
    use std::net::TcpListener;
    use std::thread::{sleep, spawn, JoinHandle};
    use std::time::Instant;

    const LENGTH: usize = 300;

    fn file() -> Vec<u8> {
        (0..LENGTH).map(|at| at as u8).collect()
    }

    fn answer(head: &str, body: &[u8]) -> Vec<u8> {
        let head = head.replace('\n', "\r\n");
        let head = format!("HTTP/1.1 {head}\r\nconnection: close\r\n\r\n");
        [head.as_bytes(), body].concat()
    }

    fn whole(come: usize) -> Vec<u8> {
        answer("200 OK\ncontent-length: 300", &file()[..come])
    }

    fn rest(from: usize, to: usize) -> Vec<u8> {
        let left = LENGTH - from;
        let head = format!(
            "206 Partial Content\ncontent-length: {left}\ncontent-range: bytes {from}-299/300"
        );
        answer(&head, &file()[from..to])
    }

    /// A server of these answers, one on each connection. Returns the requests' heads.
    fn served(answers: &[Vec<u8>]) -> (Web, JoinHandle<Vec<String>>) {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let url = format!("http://{}", listener.local_addr().unwrap());
        let answers = answers.to_vec();
        let server = spawn(move || {
            let answered = answers.into_iter().map(|answer| {
                let (mut stream, _) = listener.accept().unwrap();
                let mut head = Vec::new();
                while !head.ends_with(b"\r\n\r\n") {
                    let mut byte = [0];
                    stream.read_exact(&mut byte).unwrap();
                    head.push(byte[0]);
                }
                stream.write_all(&answer).unwrap();
                String::from_utf8(head).unwrap().to_lowercase()
            });
            answered.collect()
        });
        (Web::at(&url, None).unwrap(), server)
    }

    fn read(web: &Web) -> Result<Option<Vec<u8>>, SourceError> {
        web.get("x", 1000)
    }

    fn refused(answers: &[Vec<u8>]) -> String {
        let (web, server) = served(answers);
        let error = read(&web).unwrap_err().to_string();
        assert_eq!(server.join().unwrap().len(), answers.len());
        error
    }

    #[test]
    fn a_file_that_is_cut_goes_on_where_it_was() {
        let (web, server) = served(&[whole(100), rest(100, 150), rest(150, 300)]);
        assert_eq!(read(&web).unwrap(), Some(file()));
        let heads = server.join().unwrap();
        assert!(!heads[0].contains("range: "), "{}", heads[0]);
        assert!(
            heads[1].contains("\r\nrange: bytes=100-\r\n"),
            "{}",
            heads[1]
        );
        assert!(
            heads[2].contains("\r\nrange: bytes=150-\r\n"),
            "{}",
            heads[2]
        );
    }

    #[test]
    fn a_server_that_knows_no_ranges_sends_the_file_again_and_nothing_is_read_twice() {
        // The second answer ends before the missing part.
        let (web, server) = served(&[whole(100), whole(50), whole(300)]);
        assert_eq!(read(&web).unwrap(), Some(file()));
        server.join().unwrap();
    }

    #[test]
    fn a_server_that_is_busy_is_asked_again() {
        let busy = answer("503 X\nretry-after: 1\ncontent-length: 0", b"");
        let (web, server) = served(&[busy.clone(), whole(10), busy, rest(10, 300)]);
        let begun = Instant::now();
        assert_eq!(read(&web).unwrap(), Some(file()));
        assert!(begun.elapsed() >= Duration::from_secs(2));
        server.join().unwrap();
    }

    #[test]
    fn a_server_that_publishes_nothing_yet_is_asked_three_times() {
        let nothing = answer("503 X\ncontent-length: 7", b"not yet");
        let begun = Instant::now();
        let error = refused(&[nothing.clone(), nothing.clone(), nothing]);
        assert!(error.ends_with("status 503: not yet"), "{error}");
        assert!(begun.elapsed() < Duration::from_secs(10));
        // A failure that does not pass is not tried again.
        let error = refused(&[answer("500 X\ncontent-length: 0", b"")]);
        assert!(error.ends_with("status 500"), "{error}");
    }

    #[test]
    fn an_answer_with_other_bytes_than_those_that_are_missing_is_refused() {
        let other = "206 X\ncontent-length: 200\ncontent-range: bytes 99-298/300";
        let error = refused(&[whole(100), answer(other, &file()[99..299])]);
        assert!(
            error.contains("answers with others: bytes 99-298/300"),
            "{error}"
        );
        let longer = "200 OK\ncontent-length: 301";
        let error = refused(&[whole(100), answer(longer, &[0; 301])]);
        assert!(error.contains("the file had 300 bytes"), "{error}");
        let gone = answer("404 X\ncontent-length: 0", b"");
        let error = refused(&[whole(100), gone]);
        assert!(error.contains("no more"), "{error}");
    }

    #[test]
    fn an_address_where_nobody_answers_is_not_asked_again() {
        let (web, server) = served(&[]);
        server.join().unwrap();
        let begun = Instant::now();
        assert!(read(&web).is_err());
        assert!(begun.elapsed() < Duration::from_secs(5));
    }

    #[test]
    fn a_file_may_take_longer_than_a_server_may_be_silent() {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let url = format!("http://{}", listener.local_addr().unwrap());
        spawn(move || {
            let (mut stream, _) = listener.accept().unwrap();
            let head = answer("200 OK\ncontent-length: 300", b"");
            stream.write_all(&head).unwrap();
            for byte in &file()[..8] {
                stream.write_all(&[*byte]).unwrap();
                sleep(Duration::from_millis(200));
            }
            sleep(Duration::from_secs(60));
        });
        let silence = Duration::from_secs(1);
        let client = HttpClient::for_files(Authorities::of_system("--ca"), silence).unwrap();
        let mut body = client.get_from(&url, 0).unwrap().into_body().into_reader();
        let mut come = [0; 8];
        body.read_exact(&mut come).unwrap();
        assert_eq!(come, file()[..8]);
        // Now nothing comes.
        let begun = Instant::now();
        let error = body.read(&mut come).unwrap_err();
        assert!(client.why(&ureq::Error::from(error)).may_pass());
        assert!(begun.elapsed() < Duration::from_secs(20));
    }
}
