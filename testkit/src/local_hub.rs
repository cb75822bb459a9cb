//! A Hub on loopback for publishing. It checks what it gets, and keeps repositories in memory.

use base64::prelude::{Engine as _, BASE64_STANDARD};
use serde_json::{json, Value};
use sha1::Sha1;
use sha2::{Digest, Sha256};
use std::collections::BTreeMap;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::sync::{Arc, Mutex, MutexGuard};

/// May write.
pub const TOKEN: &str = "hf_right";
/// May only read.
pub const READER: &str = "hf_reader";

/// A repository's commit.
#[derive(Clone, Debug)]
pub struct HubCommit {
    /// Its summary.
    pub summary: String,
    /// The changed files.
    pub changed: Vec<String>,
}

/// A model's repository.
#[derive(Clone, Debug, Default)]
pub struct ModelRepository {
    /// Whether it is hidden.
    pub private: bool,
    /// The newest commit's files, also those in `large`.
    pub files: BTreeMap<String, Vec<u8>>,
    /// Large files' SHA-256.
    pub large: BTreeMap<String, String>,
    /// Commits, oldest first.
    pub commits: Vec<HubCommit>,
}

/// The Hub's content and faults.
#[derive(Default)]
pub struct HubContent {
    /// Repositories by name.
    pub models: BTreeMap<String, ModelRepository>,
    /// Large files by SHA-256.
    pub storage: BTreeMap<String, Vec<u8>>,
    /// Requests, as method and path.
    pub requests: Vec<String>,
    /// Fails so many requests whose path contains the text, with this status.
    pub failing: Option<(&'static str, u16, usize)>,
    /// Cuts so many uploads in the middle.
    pub cuts: usize,
    /// Status for creating a repository.
    pub closed: Option<u16>,
    /// Takes uploads without required headers.
    pub lenient: bool,
    /// Has uploads verified elsewhere.
    pub verify_elsewhere: bool,
}

/// It runs until the process ends.
#[derive(Clone)]
pub struct LocalHub {
    /// Its URL.
    pub address: String,
    held: Arc<Mutex<HubContent>>,
}

struct Request {
    method: String,
    path: String,
    headers: BTreeMap<String, String>,
    body: Vec<u8>,
}

type HubResponse = (u16, Value);

impl LocalHub {
    /// Starts an empty Hub.
    pub fn start() -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let hub = Self {
            address: format!("http://{}", listener.local_addr().unwrap()),
            held: Arc::default(),
        };
        let serving = hub.clone();
        std::thread::spawn(move || {
            for stream in listener.incoming() {
                // The caller may have left.
                let _ = serving.answer(stream.unwrap());
            }
        });
        hub
    }

    /// The Hub's content, locked.
    pub fn held(&self) -> MutexGuard<'_, HubContent> {
        self.held.lock().unwrap()
    }

    /// A model's repository.
    #[track_caller]
    pub fn model(&self, name: &str) -> ModelRepository {
        self.held()
            .models
            .get(name)
            .cloned()
            .expect("no such repository")
    }

    /// Requests since the last call.
    pub fn asked(&self) -> Vec<String> {
        std::mem::take(&mut self.held().requests)
    }

    fn answer(&self, mut stream: TcpStream) -> std::io::Result<()> {
        let Some(request) = self.read(&stream)? else {
            return Ok(());
        };
        let (status, body) = self.decide(&request);
        let body = body.to_string();
        write!(
            stream,
            "HTTP/1.1 {status} Status\r\ncontent-type: application/json\r\ncontent-length: {}\r\nconnection: close\r\n\r\n{body}",
            body.len()
        )
    }

    /// `None` cuts the connection.
    fn read(&self, stream: &TcpStream) -> std::io::Result<Option<Request>> {
        let mut reader = BufReader::new(stream);
        let mut line = String::new();
        reader.read_line(&mut line)?;
        let mut words = line.split_whitespace().map(str::to_owned);
        let (Some(method), Some(path)) = (words.next(), words.next()) else {
            return Ok(None);
        };
        self.held().requests.push(format!("{method} {path}"));
        let mut headers = BTreeMap::new();
        loop {
            let mut line = String::new();
            reader.read_line(&mut line)?;
            let Some((name, value)) = line.trim_end().split_once(": ") else {
                break;
            };
            headers.insert(name.to_lowercase(), value.to_owned());
        }
        let length = headers.get("content-length");
        let length = length.map_or(0, |length| length.parse().unwrap());
        let cut = path.starts_with("/storage/") && self.held().cuts > 0;
        if cut {
            self.held().cuts -= 1;
            reader.take(length / 2).read_to_end(&mut Vec::new())?;
            return Ok(None);
        }
        let mut body = Vec::new();
        reader.take(length).read_to_end(&mut body)?;
        Ok(Some(Request {
            method,
            path,
            headers,
            body,
        }))
    }

    fn decide(&self, request: &Request) -> HubResponse {
        let mut held = self.held();
        if let Some((text, status, times)) = &mut held.failing {
            if *times > 0 && request.path.contains(*text) {
                *times -= 1;
                return (*status, json!({ "error": "it is broken" }));
            }
        }
        let token = request.headers.get("authorization").cloned();
        let path = request.path.as_str();
        if let Some(oid) = path.strip_prefix("/storage/") {
            return held.store(oid, request, token.is_some());
        }
        let may_write = match token.as_deref() {
            Some("Bearer hf_right") => true,
            Some("Bearer hf_reader") => false,
            _ => return (401, json!({ "error": "Invalid username or password." })),
        };
        if !may_write && request.method == "POST" {
            return (403, json!({ "error": "You don't have the rights." }));
        }
        if path == "/api/repos/create" {
            return held.create(&request.json());
        }
        if let Some(rest) = path.strip_prefix("/api/models/") {
            let parts: Vec<_> = rest.split('/').collect();
            let name = parts[..2].join("/");
            if !held.models.contains_key(&name) {
                return (404, json!({ "error": "Repository not found" }));
            }
            return match (request.method.as_str(), &parts[2..]) {
                ("GET", []) => (200, json!({ "id": name })),
                ("POST", ["preupload", "main"]) => held.preupload(&name, &request.json()),
                ("POST", ["commit", "main"]) => held.commit(&name, request),
                _ => (404, json!({ "error": "Not found" })),
            };
        }
        if path == "/verify" {
            let asked = request.json();
            let found = held.storage.get(asked["oid"].as_str().unwrap());
            let right = found.is_some_and(|found| found.len() as u64 == asked["size"]);
            return (if right { 200 } else { 400 }, json!({}));
        }
        let batch = ".git/info/lfs/objects/batch";
        match path.strip_suffix(batch).map(|name| &name[1..]) {
            Some(name) if held.models.contains_key(name) => {
                assert_eq!(
                    request.headers["content-type"],
                    "application/vnd.git-lfs+json"
                );
                assert_eq!(request.headers["accept"], "application/vnd.git-lfs+json");
                held.batch(&self.address, &request.json())
            }
            _ => (404, json!({ "error": "Not found" })),
        }
    }
}

impl Request {
    fn json(&self) -> Value {
        serde_json::from_slice(&self.body).unwrap()
    }
}

impl HubContent {
    fn create(&mut self, asked: &Value) -> HubResponse {
        if let Some(status) = self.closed {
            return (
                status,
                json!({ "error": "You may not create a repository." }),
            );
        }
        assert!(asked["type"].is_null() || asked["type"] == "model");
        let part = |name: &str| asked[name].as_str().unwrap().to_owned();
        let name = format!("{}/{}", part("organization"), part("name"));
        if self.models.contains_key(&name) {
            return (
                409,
                json!({ "error": "You already created this model repo" }),
            );
        }
        let model = ModelRepository {
            private: asked["private"] == true,
            ..ModelRepository::default()
        };
        self.models.insert(name.clone(), model);
        (200, json!({ "url": format!("/{name}") }))
    }

    /// Files with a byte 0 in their sample, or over 10 MB, are large.
    fn preupload(&self, name: &str, asked: &Value) -> HubResponse {
        let model = &self.models[name];
        let mode = |file: &Value| {
            let path = file["path"].as_str().unwrap();
            let sample = BASE64_STANDARD.decode(file["sample"].as_str().unwrap());
            let sample = sample.unwrap();
            let size = file["size"].as_u64().unwrap();
            assert_eq!(sample.len() as u64, size.min(512), "{path}");
            let large = sample.contains(&0) || size > 10_000_000;
            let oid = match model.large.get(path) {
                Some(sha256) => Some(sha256.clone()),
                None => model.files.get(path).map(|content| git_sha1(content)),
            };
            let mode = if large { "lfs" } else { "regular" };
            let mut answer =
                json!({ "path": path, "uploadMode": mode, "shouldIgnore": path == "ignored" });
            if let Some(oid) = oid {
                answer["oid"] = oid.into();
            }
            answer
        };
        let files: Vec<_> = asked["files"]
            .as_array()
            .unwrap()
            .iter()
            .map(mode)
            .collect();
        (200, json!({ "files": files }))
    }

    fn batch(&self, address: &str, asked: &Value) -> HubResponse {
        assert_eq!(asked["operation"], "upload");
        assert_eq!(asked["hash_algo"], "sha256");
        let object = |object: &Value| {
            let oid = object["oid"].as_str().unwrap();
            let mut answer = json!({ "oid": oid, "size": object["size"] });
            if !self.storage.contains_key(oid) {
                let verify = if self.verify_elsewhere {
                    "http://127.0.0.1:9/verify".into()
                } else {
                    format!("{address}/verify")
                };
                answer["actions"] = json!({
                    "upload": { "href": format!("{address}/storage/{oid}"), "header": { "x-part": "all" } },
                    "verify": { "href": verify },
                });
            }
            answer
        };
        let objects: Vec<_> = asked["objects"]
            .as_array()
            .unwrap()
            .iter()
            .map(object)
            .collect();
        (200, json!({ "transfer": "basic", "objects": objects }))
    }

    /// The storage must not get the Hub's token.
    fn store(&mut self, oid: &str, request: &Request, has_token: bool) -> HubResponse {
        assert_eq!(request.method, "PUT");
        // Python's client omits headers that Git LFS requires.
        assert!(self.lenient || request.headers["x-part"] == "all");
        if has_token || hex::encode(Sha256::digest(&request.body)) != oid {
            return (400, json!({ "error": "wrong content, or a token" }));
        }
        self.storage.insert(oid.into(), request.body.clone());
        (200, json!({}))
    }

    fn commit(&mut self, name: &str, request: &Request) -> HubResponse {
        assert_eq!(request.headers["content-type"], "application/x-ndjson");
        let lines: Vec<Value> = std::str::from_utf8(&request.body)
            .unwrap()
            .lines()
            .map(|line| serde_json::from_str(line).unwrap())
            .collect();
        assert_eq!(lines[0]["key"], "header");
        let model = self.models.get_mut(name).unwrap();
        let mut commit = HubCommit {
            summary: lines[0]["value"]["summary"].as_str().unwrap().into(),
            changed: Vec::new(),
        };
        for line in &lines[1..] {
            let value = &line["value"];
            let path = value["path"].as_str().unwrap().to_owned();
            let content = match line["key"].as_str().unwrap() {
                "file" => {
                    assert_eq!(value["encoding"], "base64");
                    model.large.remove(&path);
                    BASE64_STANDARD
                        .decode(value["content"].as_str().unwrap())
                        .unwrap()
                }
                "lfsFile" => {
                    let oid = value["oid"].as_str().unwrap();
                    assert_eq!(value["algo"], "sha256");
                    let Some(content) = self.storage.get(oid) else {
                        return (400, json!({ "error": "the large file was not uploaded" }));
                    };
                    assert_eq!(value["size"], content.len() as u64);
                    model.large.insert(path.clone(), oid.into());
                    content.clone()
                }
                other => panic!("{other}"),
            };
            model.files.insert(path.clone(), content);
            commit.changed.push(path);
        }
        model.commits.push(commit);
        let oid = format!("{:040x}", model.commits.len());
        (
            200,
            json!({ "commitOid": oid, "commitUrl": format!("/{name}/commit/{oid}") }),
        )
    }
}

fn git_sha1(content: &[u8]) -> String {
    let mut sha1 = Sha1::new();
    sha1.update(format!("blob {}\0", content.len()));
    sha1.update(content);
    hex::encode(sha1.finalize())
}
