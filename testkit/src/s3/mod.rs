//! A real S3 server on loopback (`s3s-fs`, which keeps objects as files) behind a network that fails.

pub mod failing_network;
mod google;

use self::failing_network::FailingNetwork;
use crate::own_port::OwnPort;
use crate::skipped::skipped;
use crate::until;
use std::env;
use std::fs;
use std::io::{Read, Write};
use std::net::TcpStream;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::thread::sleep;
use std::time::Duration;
use tempfile::TempDir;

const ACCESS_KEY: &str = "zk0-tests";
const SECRET_KEY: &str = "a secret of the tests";

/// The existing bucket.
pub const BUCKET: &str = "blobs";

/// Sends a request with a body. Returns the status.
pub fn send(method: &str, address: &str, body: &[u8]) -> u16 {
    send_in_parts(method, address, &[body], Duration::ZERO)
}

/// [`send`] with pauses between parts.
pub fn send_in_parts(method: &str, address: &str, body: &[&[u8]], apart: Duration) -> u16 {
    let (host, path) = address
        .strip_prefix("http://")
        .unwrap()
        .split_once('/')
        .unwrap();
    let mut server = TcpStream::connect(host).unwrap();
    let length: usize = body.iter().map(|part| part.len()).sum();
    let head = format!(
        "{method} /{path} HTTP/1.1\r\nhost: {host}\r\ncontent-length: {length}\r\nconnection: close\r\n\r\n"
    );
    server.write_all(head.as_bytes()).unwrap();
    for part in body {
        // The server may cut a refused request.
        let _ = server.write_all(part);
        sleep(apart);
    }
    let mut answer = Vec::new();
    let _ = server.read_to_end(&mut answer);
    let status = String::from_utf8_lossy(&answer);
    let status = status.split(' ').nth(1).unwrap_or_default();
    status.parse().unwrap_or(0)
}

/// Ended on drop.
pub struct S3 {
    process: Child,
    root: TempDir,
    port: OwnPort,
    speaks: Speaks,
    /// Between server and clients.
    pub network: FailingNetwork,
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Speaks {
    Amazons,
    Googles,
}

fn program() -> Option<PathBuf> {
    let home = env::var_os("CARGO_HOME").map(PathBuf::from);
    let home = home.or_else(|| Some(PathBuf::from(env::var_os("HOME")?).join(".cargo")));
    let installed = home.map(|home| home.join("bin"));
    let path = env::var_os("PATH").unwrap_or_default();
    env::split_paths(&path)
        .chain(installed)
        .map(|folder| folder.join("s3s-fs"))
        .find(|program| program.is_file())
}

/// Starts a server of the buckets in `root`. It cannot report its port, so it gets one.
fn started(program: &Path, credentials: &[&str], root: &Path) -> (Child, OwnPort) {
    let port = OwnPort::take();
    let process = Command::new(program)
        .args(["--host", "127.0.0.1", "--port", &port.number().to_string()])
        .args(credentials)
        .arg(root)
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    until("s3s-fs serves", || {
        TcpStream::connect(port.address()).is_ok()
    });
    (process, port)
}

/// The same buckets without authentication.
pub struct OpenToAll {
    process: Child,
    port: OwnPort,
}

impl OpenToAll {
    /// A prefix's URL.
    pub fn url(&self, prefix: &str) -> String {
        format!("http://{}/{BUCKET}/{prefix}", self.port.address())
    }
}

impl Drop for OpenToAll {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

impl S3 {
    /// Starts a server. If its program is missing, prints how to get it.
    pub fn start() -> Option<Self> {
        Self::speaking(Speaks::Amazons)
    }

    /// [`Self::start`] as Google Cloud Storage. Verifies no identity and no signature.
    pub fn start_as_google() -> Option<Self> {
        google::key()?;
        Self::speaking(Speaks::Googles)
    }

    fn speaking(speaks: Speaks) -> Option<Self> {
        let Some(program) = program() else {
            skipped("there is no s3s-fs; scripts/setup.sh guest installs it");
            return None;
        };
        let root = tempfile::tempdir().unwrap();
        fs::create_dir(root.path().join(BUCKET)).unwrap();
        let credentials = ["--access-key", ACCESS_KEY, "--secret-key", SECRET_KEY];
        let (credentials, translation): (&[&str], _) = match speaks {
            Speaks::Amazons => (&credentials, None),
            Speaks::Googles => (&[], Some(google::TO_S3)),
        };
        let (process, port) = started(&program, credentials, root.path());
        Some(Self {
            process,
            root,
            network: FailingNetwork::in_front_of(port.number(), translation),
            port,
            speaks,
        })
    }

    /// A client's variables.
    pub fn variables(&self) -> Vec<(String, String)> {
        match self.speaks {
            Speaks::Amazons => self.variables_with(SECRET_KEY),
            Speaks::Googles => google::variables(&self.network.address()),
        }
    }

    /// [`Self::variables`] past the failing network.
    pub fn variables_without_network(&self) -> Vec<(String, String)> {
        let mut variables = self.variables();
        for (name, value) in &mut variables {
            if name == "AWS_ENDPOINT" {
                *value = format!("http://{}", self.port.address());
            }
        }
        variables
    }

    /// [`Self::variables`] with another secret.
    pub fn variables_with(&self, secret: &str) -> Vec<(String, String)> {
        [
            ("AWS_ACCESS_KEY_ID", ACCESS_KEY),
            ("AWS_SECRET_ACCESS_KEY", secret),
            ("AWS_ENDPOINT", &self.network.address()),
            ("AWS_ALLOW_HTTP", "true"),
        ]
        .map(|(name, value)| (name.to_owned(), value.to_owned()))
        .into()
    }

    /// The process number.
    pub fn process(&self) -> u32 {
        self.process.id()
    }

    /// A prefix's address.
    pub fn address(&self, prefix: &str) -> String {
        let scheme = match self.speaks {
            Speaks::Amazons => "s3",
            Speaks::Googles => "gs",
        };
        format!("{scheme}://{BUCKET}/{prefix}")
    }

    /// A blob's file.
    pub fn file(&self, prefix: &str, blob: impl ToString) -> PathBuf {
        self.folder(prefix).join(blob.to_string())
    }

    /// A prefix's blobs.
    pub fn folder(&self, prefix: &str) -> PathBuf {
        self.root(prefix).join("blobs").join("sha256")
    }

    /// A prefix's folder.
    pub fn root(&self, prefix: &str) -> PathBuf {
        self.root.path().join(BUCKET).join(prefix)
    }

    /// Objects under a prefix.
    pub fn objects(&self, prefix: &str) -> usize {
        fn files(folder: &Path) -> usize {
            let Ok(found) = fs::read_dir(folder) else {
                return 0;
            };
            let paths = found.map(|file| file.unwrap().path());
            paths
                .map(|path| if path.is_dir() { files(&path) } else { 1 })
                .sum()
        }
        files(&self.root(prefix))
    }

    /// Makes the bucket readable by all, as an owner may.
    pub fn open_to_all(&self) -> OpenToAll {
        let program = program().unwrap();
        let (process, port) = started(&program, &[], self.root.path());
        OpenToAll { process, port }
    }

    /// Files of unfinished uploads.
    pub fn unfinished(&self) -> usize {
        let files = fs::read_dir(self.root.path()).unwrap();
        files
            .filter(|file| {
                let name = file.as_ref().unwrap().file_name();
                name.to_string_lossy().contains(".part-")
            })
            .count()
    }
}

impl Drop for S3 {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}
