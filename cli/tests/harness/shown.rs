//! What a running service shows at the address of its metrics.

use std::io::{Read, Write};
use std::net::TcpStream;
use zk0_testkit::until;

/// An address of metrics.
pub struct Shown(pub String);

impl Shown {
    /// The whole answer to a request.
    pub fn get(&self, path: &str) -> String {
        let mut stream = TcpStream::connect(&self.0).unwrap();
        let head = format!("GET {path} HTTP/1.1\r\nhost: zk0\r\nconnection: close\r\n\r\n");
        stream.write_all(head.as_bytes()).unwrap();
        let mut answer = String::new();
        stream.read_to_string(&mut answer).unwrap();
        answer
    }

    /// The value of a metric with these labels; 0 if there is none yet.
    pub fn metric(&self, name: &str) -> f64 {
        let text = self.get("/metrics");
        let mut values = text.lines().filter_map(|line| {
            let (key, value) = line.rsplit_once(' ')?;
            (key == name).then(|| value.parse().unwrap())
        });
        values.next().unwrap_or(0.0)
    }

    /// Waits until the metric has this value.
    #[track_caller]
    pub fn becomes(&self, name: &str, wanted: f64) {
        until(format!("{name} is {wanted}"), || {
            self.metric(name) == wanted
        });
    }

    /// Checks that the service states that it is in order, or that it is not and why.
    #[track_caller]
    pub fn is_healthy(&self, wrong: Option<&str>) {
        let answer = self.get("/health");
        let status = if wrong.is_some() { "503" } else { "200" };
        let begins = format!("HTTP/1.1 {status} ");
        assert!(answer.starts_with(&begins), "{answer}");
        assert!(answer.contains(wrong.unwrap_or_default()), "{answer}");
    }
}
