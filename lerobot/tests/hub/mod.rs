//! Recordings from a Hub: a small server in this process speaks the part of its protocol that is needed.

mod faults;
mod pictures;

use std::collections::HashMap;
use std::fs;
use std::io::{BufRead, BufReader, Write};
use std::net::{TcpListener, TcpStream};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};

use sha2::{Digest, Sha256};
use tempfile::TempDir;
use zk0_lerobot::dataset::Dataset;
use zk0_lerobot::hub::{fetch, Fetched, HubError, HubOptions, HubProgress, HubRecording};
use zk0_testkit::recordings::{open, recording, DATA};

const COMMIT: &str = "0123456789abcdef0123456789abcdef01234567";
const NAME: &str = "robots/so100";

/// How the server misbehaves.
#[derive(Default)]
struct Manners {
    /// The commit that the tag `v3.0` names.
    tag: Option<&'static str>,
    /// Lists files, and gives them to nobody.
    gated: bool,
    /// Answers only callers with this token.
    token: Option<&'static str>,
    /// Cuts the connection in the middle of the body, for this many of the first requests for a file's content.
    cuts: usize,
    /// Sends other bytes than it lists, for this many of the first requests for a file's content.
    lies: usize,
    /// The listing has the second text in place of the first.
    other_listing: Option<(&'static str, &'static str)>,
    /// Sends every reader of a file elsewhere, and does not name the place.
    leads_nowhere: bool,
    /// So many spaces follow the listing.
    spaces: usize,
    /// Lists this file as well.
    extra: Option<&'static str>,
    /// Sends every file without its second half, and states that this is all.
    halves: bool,
}

struct Hub {
    address: String,
    requests: Arc<Mutex<Vec<String>>>,
    manners: Arc<Mutex<Manners>>,
}

impl Hub {
    /// Serves a fixture's folder until the test process ends.
    fn start(name: &str, manners: Manners) -> Self {
        Self::serving(&recording(name), manners)
    }

    fn serving(folder: &Path, manners: Manners) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let hub = Self {
            address: format!("http://{}", listener.local_addr().unwrap()),
            requests: Arc::default(),
            manners: Arc::new(Mutex::new(manners)),
        };
        let mut files = HashMap::new();
        collect(folder, "", &mut files);
        files.insert("README.md".into(), b"not wanted".to_vec());
        let (requests, manners) = (hub.requests.clone(), hub.manners.clone());
        std::thread::spawn(move || {
            for stream in listener.incoming() {
                // It is not the server's fault if the caller has closed the connection.
                let _ = answer(stream.unwrap(), &files, &requests, &manners);
            }
        });
        hub
    }

    fn options(&self, cache: &Path) -> HubOptions {
        HubOptions {
            endpoint: self.address.clone(),
            token: None,
            cache: cache.to_path_buf(),
        }
    }

    /// Paths asked for since the last time.
    fn asked(&self) -> Vec<String> {
        std::mem::take(&mut self.requests.lock().unwrap())
    }
}

fn collect(folder: &Path, prefix: &str, files: &mut HashMap<String, Vec<u8>>) {
    for entry in fs::read_dir(folder).unwrap() {
        let entry = entry.unwrap();
        let name = format!("{prefix}{}", entry.file_name().to_str().unwrap());
        match entry.file_type().unwrap().is_dir() {
            true => collect(&entry.path(), &format!("{name}/"), files),
            false => drop(files.insert(name, fs::read(entry.path()).unwrap())),
        }
    }
}

fn hash(bytes: &[u8]) -> String {
    hex::encode(Sha256::digest(bytes))
}

/// Answers one request, and then closes the connection.
fn answer(
    mut stream: TcpStream,
    files: &HashMap<String, Vec<u8>>,
    requests: &Mutex<Vec<String>>,
    manners: &Mutex<Manners>,
) -> std::io::Result<()> {
    let mut reader = BufReader::new(stream.try_clone()?);
    let mut lines = Vec::new();
    loop {
        let mut line = String::new();
        if reader.read_line(&mut line)? == 0 || line == "\r\n" {
            break;
        }
        lines.push(line.trim().to_owned());
    }
    let Some(path) = lines.first().and_then(|l| l.split(' ').nth(1)) else {
        return Ok(());
    };
    let header = |name: &str| {
        let mut fields = lines.iter().filter_map(|l| l.split_once(": "));
        fields
            .find(|(n, _)| n.eq_ignore_ascii_case(name))
            .map(|(_, v)| v)
    };
    let mut manners = manners.lock().unwrap();
    requests.lock().unwrap().push(path.to_owned());
    let status = |stream: &mut TcpStream, status: &str| {
        write!(
            stream,
            "HTTP/1.1 {status}\r\nContent-Length: 0\r\nConnection: close\r\n\r\n"
        )
    };
    if manners
        .token
        .is_some_and(|t| header("authorization") != Some(format!("Bearer {t}").as_str()))
    {
        return status(&mut stream, "401 Unauthorized");
    }
    if path == format!("/api/datasets/{NAME}/revision/main?blobs=true") {
        // Large files are listed with their SHA-256. Small files are listed with git's hash, of which only the form matters here.
        let mut siblings: Vec<_> = files
            .iter()
            .map(|(name, bytes)| {
                let hash = hash(bytes);
                let lfs = (!name.starts_with("meta/")).then(|| serde_json::json!({"sha256": hash, "size": bytes.len()}));
                serde_json::json!({"rfilename": name, "size": bytes.len(), "blobId": hash[..40], "lfs": lfs})
            })
            .collect();
        if let Some(name) = manners.extra {
            siblings.push(serde_json::json!({"rfilename": name, "size": 1, "blobId": COMMIT}));
        }
        let mut body = serde_json::json!({"sha": COMMIT, "siblings": siblings}).to_string();
        if let Some((text, other)) = manners.other_listing {
            assert!(body.contains(text), "{text}");
            body = body.replace(text, other);
        }
        body.push_str(&" ".repeat(manners.spaces));
        return write!(
            stream,
            "HTTP/1.1 200 OK\r\nContent-Type: application/json\r\nContent-Length: {}\r\nConnection: close\r\n\r\n{body}",
            body.len()
        );
    }
    if path == format!("/api/datasets/{NAME}/revision/v3.0") {
        let Some(tag) = manners.tag else {
            return status(&mut stream, "404 Not Found");
        };
        let body = serde_json::json!({"sha": tag, "siblings": []}).to_string();
        return write!(
            stream,
            "HTTP/1.1 200 OK\r\nContent-Type: application/json\r\nContent-Length: {}\r\nConnection: close\r\n\r\n{body}",
            body.len()
        );
    }
    if manners.gated {
        return status(&mut stream, "403 Forbidden");
    }
    if manners.leads_nowhere {
        return write!(
            stream,
            "HTTP/1.1 302 Found\r\nContent-Length: 0\r\nETag: \"{COMMIT}\"\r\nX-Repo-Commit: {COMMIT}\r\nConnection: close\r\n\r\n"
        );
    }
    let name = path.strip_prefix(&format!("/datasets/{NAME}/resolve/{COMMIT}/"));
    let Some((name, bytes)) = name.and_then(|name| files.get_key_value(name)) else {
        return status(&mut stream, "404 Not Found");
    };
    let range = header("range")
        .and_then(|r| r.strip_prefix("bytes="))
        .unwrap_or("0-");
    let (from, to) = range.split_once('-').unwrap();
    let from: usize = from.parse().unwrap();
    let end = to
        .parse()
        .map_or(bytes.len(), |to: usize| (to + 1).min(bytes.len()));
    if from >= bytes.len() {
        return status(&mut stream, "416 Range Not Satisfiable");
    }
    let etag = match name.starts_with("meta/") {
        true => hash(bytes)[..40].to_owned(),
        false => hash(bytes),
    };
    let mut body = bytes[from..end].to_vec();
    let is_content = to.is_empty();
    let mut cut = body.len();
    if is_content && manners.lies > 0 {
        manners.lies -= 1;
        body.iter_mut().for_each(|b| *b ^= 1);
    }
    if is_content && manners.halves {
        body.truncate(body.len() / 2);
        cut = body.len();
    }
    if is_content && manners.cuts > 0 {
        manners.cuts -= 1;
        cut /= 2;
    }
    write!(
        stream,
        "HTTP/1.1 206 Partial Content\r\nContent-Length: {}\r\nContent-Range: bytes {from}-{}/{}\r\nETag: \"{etag}\"\r\n\
         X-Repo-Commit: {COMMIT}\r\nConnection: close\r\n\r\n",
        body.len(),
        end - 1,
        bytes.len()
    )?;
    stream.write_all(&body[..cut])
}

fn cache() -> TempDir {
    tempfile::tempdir().unwrap()
}

fn get(options: &HubOptions) -> Result<PathBuf, HubError> {
    fetched(options).map(|fetched| fetched.folder)
}

fn fetched(options: &HubOptions) -> Result<Fetched, HubError> {
    fetch(&NAME.parse().unwrap(), options, &mut |_| ())
}

/// Checks that the recording equals the one in the fixtures, in every byte of every file and as a dataset.
#[track_caller]
fn is_whole(folder: &Path, name: &str) {
    let (mut here, mut there) = (HashMap::new(), HashMap::new());
    collect_followed(folder, "", &mut here);
    collect(&recording(name), "", &mut there);
    assert!(here == there, "{:?}", here.keys());
    let (ours, like) = (Dataset::open(folder).unwrap(), open(name));
    assert!(ours.frame(100, 10).unwrap() == like.frame(100, 10).unwrap());
}

/// Collects the files as [`collect`] does, through the links that the cache is made of.
fn collect_followed(folder: &Path, prefix: &str, files: &mut HashMap<String, Vec<u8>>) {
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let name = format!("{prefix}{}", path.file_name().unwrap().to_str().unwrap());
        match path.is_dir() {
            true => collect_followed(&path, &format!("{name}/"), files),
            false => drop(files.insert(name, fs::read(path).unwrap())),
        }
    }
}

#[test]
fn a_recording_is_downloaded_once() {
    for name in ["so100_sorting", "so100_pickplace_v21"] {
        let (hub, cache) = (Hub::start(name, Manners::default()), cache());
        let options = hub.options(cache.path());
        let mut seen: Vec<HubProgress> = Vec::new();
        let fetched = fetch(&NAME.parse().unwrap(), &options, &mut |at| seen.push(at)).unwrap();
        let folder = fetched.folder;
        is_whole(&folder, name);
        assert!(folder.ends_with(format!("datasets--robots--so100/snapshots/{COMMIT}")));
        let asked = hub.asked();
        assert!(asked.len() > 10 && !asked.iter().any(|path| path.contains("README")));
        let last = seen.last().unwrap();
        assert_eq!((last.files, last.bytes), (last.of_files, last.of_bytes));
        assert!(seen.windows(2).all(|w| w[0].files <= w[1].files));

        // A second call only reads the list of files, and which commit LeRobot takes.
        assert_eq!(get(&options).unwrap(), folder);
        assert_eq!(
            hub.asked(),
            ["main?blobs=true", "v3.0"]
                .map(|asked| format!("/api/datasets/{NAME}/revision/{asked}"))
        );

        // Without the Hub, the call returns what is already there.
        let nowhere = HubOptions {
            endpoint: "http://127.0.0.1:1".into(),
            ..options
        };
        assert_eq!(get(&nowhere).unwrap(), folder);
    }
}

#[test]
fn connections_that_are_cut_are_taken_up_again() {
    let manners = Manners {
        cuts: 2,
        ..Manners::default()
    };
    let (hub, cache) = (Hub::start("so101_pickplace", manners), cache());
    let folder = get(&hub.options(cache.path())).unwrap();
    is_whole(&folder, "so101_pickplace");
    assert_eq!(hub.manners.lock().unwrap().cuts, 0);
}

#[test]
fn files_that_are_not_whole_are_never_used() {
    // If the connection is cut at every request, the result is an error, and no file has its name yet.
    let manners = Manners {
        cuts: usize::MAX,
        ..Manners::default()
    };
    let (hub, cache) = (Hub::start("so101_pickplace", manners), cache());
    let options = hub.options(cache.path());
    let error = get(&options).unwrap_err();
    assert!(matches!(error, HubError::Download { .. }), "{error}");
    assert!(error.to_string().contains("run the command again"));
    // When the Hub sends whole files again, the download goes on from there.
    hub.manners.lock().unwrap().cuts = 0;
    is_whole(&get(&options).unwrap(), "so101_pickplace");

    // The server sends short files and states that they are whole.
    let manners = Manners {
        halves: true,
        ..Manners::default()
    };
    let (hub, cache) = (Hub::start("so101_pickplace", manners), self::cache());
    let error = get(&hub.options(cache.path())).unwrap_err().to_string();
    assert!(error.contains(" bytes came where "), "{error}");
    let snapshot = cache
        .path()
        .join(format!("datasets--robots--so100/snapshots/{COMMIT}"));
    let mut left = HashMap::new();
    if snapshot.is_dir() {
        collect_followed(&snapshot, "", &mut left);
    }
    assert!(left.is_empty(), "{:?}", left.keys());

    // A file in the cache has lost its end since the download.
    let (hub, cache) = (
        Hub::start("so101_pickplace", Manners::default()),
        self::cache(),
    );
    let options = hub.options(cache.path());
    let folder = get(&options).unwrap();
    let info = fs::canonicalize(folder.join("meta/info.json")).unwrap();
    fs::write(&info, b"{").unwrap();
    is_whole(&get(&options).unwrap(), "so101_pickplace");
}

#[test]
fn other_bytes_than_listed_are_noticed() {
    let lies = |lies| Manners {
        lies,
        ..Manners::default()
    };
    // The list holds only the size of metadata files, but the SHA-256 of tables and videos.
    let (hub, cache) = (Hub::start("so101_pickplace", lies(usize::MAX)), cache());
    let error = get(&hub.options(cache.path())).unwrap_err().to_string();
    assert!(error.contains("its SHA-256 is "), "{error}");
    // Others use this cache, too, and would take what is there for the file that was asked for.
    let mut left = HashMap::new();
    collect(&blobs(cache.path()), "", &mut left);
    for (name, bytes) in left.iter().filter(|(name, _)| name.len() == 64) {
        assert_eq!(*name, hash(bytes));
    }
}

/// Where the cache has the content of the recording's files.
fn blobs(cache: &Path) -> PathBuf {
    cache.join("datasets--robots--so100/blobs")
}

#[test]
fn refusals_say_what_to_do() {
    let manners = Manners {
        token: Some("hf_secret"),
        ..Manners::default()
    };
    let (hub, cache) = (Hub::start("so101_pickplace", manners), cache());
    let mut options = hub.options(cache.path());
    let error = get(&options).unwrap_err().to_string();
    assert!(
        error.contains("HTTP 401") && error.contains("set HF_TOKEN"),
        "{error}"
    );
    options.token = Some("hf_secret".into());
    is_whole(&get(&options).unwrap(), "so101_pickplace");

    let other: HubRecording = "robots/none@v1".parse().unwrap();
    let error = fetch(&other, &options, &mut |_| ()).unwrap_err();
    assert!(
        error
            .to_string()
            .contains("robots/none@v1 at http://127.0.0.1"),
        "{error}"
    );
    assert!(matches!(error, HubError::NotFound { .. }), "{error}");

    let nowhere = HubOptions {
        endpoint: "http://127.0.0.1:1".into(),
        cache: cache.path().join("other"),
        ..options
    };
    let error = get(&nowhere).unwrap_err().to_string();
    assert!(
        error.contains("cannot be asked") && error.contains("is there a network?"),
        "{error}"
    );
}

#[test]
fn the_commit_is_named_and_lerobot_s_where_it_is_another() {
    const OLDER: &str = "fedcba9876543210fedcba9876543210fedcba98";
    for (tag, lerobot) in [
        (None, None),
        (Some(COMMIT), None),
        (Some(OLDER), Some(OLDER)),
        (Some("no commit"), None),
        (Some("0123abcd"), None),
    ] {
        let manners = Manners {
            tag,
            ..Manners::default()
        };
        let (hub, cache) = (Hub::start("so101_pickplace", manners), cache());
        let options = hub.options(cache.path());
        let fetched = fetched(&options).unwrap();
        assert_eq!(fetched.commit, COMMIT);
        assert_eq!(fetched.lerobot_commit.as_deref(), lerobot);
        // Without the Hub, the commit is known all the same.
        let nowhere = HubOptions {
            endpoint: "http://127.0.0.1:1".into(),
            ..options
        };
        assert_eq!(self::fetched(&nowhere).unwrap().commit, COMMIT);
    }
}

#[test]
fn a_gated_recording_and_a_cache_that_cannot_be_written_are_named() {
    let manners = Manners {
        gated: true,
        ..Manners::default()
    };
    let (hub, cache) = (Hub::start("so101_pickplace", manners), cache());
    let mut options = hub.options(cache.path());
    let error = get(&options).unwrap_err().to_string();
    let page = format!("ask for access at {}/datasets/{NAME}, ", hub.address);
    assert!(
        error.contains("HTTP 403") && error.contains(&page),
        "{error}"
    );
    let asked = hub.asked();
    let content = asked.iter().filter(|path| path.contains("/resolve/"));
    assert_eq!(content.count(), 1, "to repeat it would be of no use");

    hub.manners.lock().unwrap().gated = false;
    options.cache = cache.path().join("file/hub");
    fs::write(cache.path().join("file"), "no folder").unwrap();
    let error = get(&options).unwrap_err();
    assert!(matches!(error, HubError::Cache { .. }), "{error}");
    let error = error.to_string();
    assert!(
        error.contains("file/hub: ") && error.contains("set HF_HOME"),
        "{error}"
    );
}
