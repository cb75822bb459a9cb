//! An aggregator of its own process, and what it costs.

use serde_json::Value;
use std::fs;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::process::{Child, Command, Stdio};
use std::thread;
use tempfile::TempDir;
use zk0_circuits::Digest;
use zk0_testkit::members::{found, Member};
use zk0_testkit::s3::S3;

/// Ticks of the clock in which Linux counts the time of processes, in a second.
const TICKS: f64 = 100.0;

/// What uploads cost.
pub struct Cost {
    /// Seconds until all updates were with the aggregator.
    pub upload: f64,
    /// Seconds after that until all were blobs of the bucket, and commitments on the ledger.
    pub commit: f64,
    /// Seconds of the aggregator's processors.
    pub cpu: f64,
    /// The most memory that the aggregator has had, in MiB.
    pub memory: f64,
    /// What the aggregator wrote to its disk, in MB.
    pub written: f64,
    /// Seconds of the S3 server's processors.
    pub server_cpu: f64,
}

/// A serving aggregator, ended when it is dropped.
pub struct Aggregator {
    process: Child,
    pub network: Digest,
    pub address: String,
    /// Where its metrics are.
    metrics: String,
    _dir: TempDir,
}

impl Aggregator {
    /// Founds a network of these members, and serves it with its blobs in the bucket.
    pub fn start(program: &str, s3: &S3, members: &[Member], bytes: u64, more: &[&str]) -> Self {
        let dir = tempfile::tempdir().expect("a folder");
        let run = |arguments: &[&str]| {
            let output = Command::new(program).args(arguments).output();
            let output = output.unwrap_or_else(|error| panic!("{program}: {error}"));
            let reported = String::from_utf8_lossy(&output.stderr).into_owned();
            assert!(output.status.success(), "{arguments:?}: {reported}");
            String::from_utf8(output.stdout).expect("text")
        };
        let network = found(dir.path(), members, bytes, run);
        let mut command = Command::new(program);
        command
            .args(["--log", "json", "aggregator", "serve"])
            .arg(dir.path().join("ledger"))
            .arg("--key")
            .arg(dir.path().join("log.key"))
            .args(["--blob-store", &s3.address("net")])
            .args(["--listen", "127.0.0.1:0", "--metrics", "127.0.0.1:0"])
            .args(["--min-nodes", &members.len().to_string()])
            .args(more)
            .envs(s3.variables_without_network())
            .stderr(Stdio::piped());
        let mut process = command.spawn().expect("it starts");
        let mut log = BufReader::new(process.stderr.take().expect("its log")).lines();
        let (mut address, mut metrics) = (None, None);
        while address.is_none() || metrics.is_none() {
            let line = log.next().expect("it goes on").expect("text");
            let line: Value = serde_json::from_str(&line).expect("JSON");
            let reported = line["message"].as_str().unwrap_or_default();
            if let Some((_, at)) = reported.split_once("the metrics are at http://") {
                metrics = Some(at.trim_end_matches("/metrics").to_owned());
            }
            if let Some(at) = line["listening"].as_str() {
                address = Some(format!("http://{at}"));
            }
        }
        // Whoever does not read its log would hold it.
        thread::spawn(move || {
            for line in log.map_while(Result::ok) {
                if !line.contains("\"INFO\"") {
                    eprintln!("{line}");
                }
            }
        });
        Self {
            process,
            network,
            address: address.expect("it listens"),
            metrics: metrics.expect("it has metrics"),
            _dir: dir,
        }
    }

    /// How many updates came this way.
    pub fn came_from(&self, from: &str) -> f64 {
        let mut stream = TcpStream::connect(&self.metrics).expect("it serves metrics");
        let head = b"GET /metrics HTTP/1.1\r\nhost: zk0\r\nconnection: close\r\n\r\n";
        stream.write_all(head).expect("sent");
        let mut text = String::new();
        stream.read_to_string(&mut text).expect("read");
        number(&text, &format!("zk0_uploads_total{{from=\"{from}\"}}"))
    }

    /// What it has cost so far.
    pub fn cost(&self, upload: f64, commit: f64, s3: &S3) -> Cost {
        let own = self.process.id();
        Cost {
            upload,
            commit,
            cpu: cpu(own),
            memory: number(&file(own, "status"), "VmHWM:") / 1024.0,
            written: number(&file(own, "io"), "write_bytes:") / 1e6,
            server_cpu: cpu(s3.process()),
        }
    }
}

/// What Linux states of a process.
fn file(process: u32, name: &str) -> String {
    let path = format!("/proc/{process}/{name}");
    fs::read_to_string(path).expect("Linux has this file")
}

/// Seconds of the processors that a process has had.
fn cpu(process: u32) -> f64 {
    let stat = file(process, "stat");
    let (_, after_name) = stat.rsplit_once(") ").expect("a name in brackets");
    let ticks = after_name.split(' ').skip(11).take(2);
    let ticks = ticks.map(|ticks| ticks.parse::<f64>().expect("ticks"));
    ticks.sum::<f64>() / TICKS
}

/// The number after a name, in text with one name in a line.
fn number(text: &str, name: &str) -> f64 {
    let mut lines = text.lines();
    let line = lines.find_map(|line| line.strip_prefix(name));
    let words = line.and_then(|line| line.split_whitespace().next());
    let words = words.unwrap_or_else(|| panic!("{name} is not in {text}"));
    words.parse().expect("a number")
}

impl Drop for Aggregator {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}
