//! Reads random lists of a recording's files from a Hub. Whatever such a list states, nothing is written outside of the cache.

use std::fs;
use std::io::{BufRead, BufReader, Write};
use std::net::{TcpListener, TcpStream};
use std::sync::{Arc, Mutex};

use zk0_lerobot::hub::{fetch, HubError, HubOptions};
use zk0_testkit::fuzzing::Target;

const COMMIT: &str = "0123456789abcdef0123456789abcdef01234567";
/// The content of every file that there is.
const CONTENT: &[u8] = b"{}";

pub fn hub_listing() -> Target {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let dir = tempfile::tempdir().unwrap();
    let options = HubOptions {
        endpoint: format!("http://{}", listener.local_addr().unwrap()),
        token: None,
        cache: dir.path().join("a/b/c/hub"),
    };
    fs::create_dir_all(&options.cache).unwrap();
    let listing = Arc::new(Mutex::new(Vec::new()));
    let served = listing.clone();
    std::thread::spawn(move || {
        for stream in listener.incoming() {
            // It is not the server's fault if the caller has closed the connection.
            let _ = answer(stream.unwrap(), &served.lock().unwrap());
        }
    });
    let file = |name: &str| serde_json::json!({"rfilename": name, "size": CONTENT.len(), "blobId": COMMIT, "lfs": null});
    let seed =
        serde_json::json!({"sha": COMMIT, "siblings": [file("meta/info.json"), file("data/0")]});
    Target {
        seeds: vec![seed.to_string().into_bytes()],
        run: Box::new(move |bytes| {
            *listing.lock().unwrap() = bytes.to_vec();
            let fetched = fetch(&"robots/so100".parse().unwrap(), &options, &mut |_| ());
            let mut folder = dir.path().to_path_buf();
            for only in ["a", "b", "c", "hub"] {
                let inside: Vec<_> = fs::read_dir(&folder).unwrap().collect();
                folder.push(only);
                assert!(
                    inside.len() == 1 && folder.is_dir(),
                    "written beside the cache: {inside:?}"
                );
            }
            fetched.map(drop).map_err(|error| match error {
                // The outcome leaves the file's name out, because the input chooses that name.
                HubError::Download { cause, .. } => match cause.split_once(" from /") {
                    Some((what, _)) => what.to_owned(),
                    None => cause,
                },
                other => other.to_string(),
            })
        }),
    }
}

/// One request, one answer, then the connection is closed.
fn answer(mut stream: TcpStream, listing: &[u8]) -> std::io::Result<()> {
    let mut reader = BufReader::new(stream.try_clone()?);
    let mut first = String::new();
    reader.read_line(&mut first)?;
    loop {
        let mut line = String::new();
        if reader.read_line(&mut line)? == 0 || line == "\r\n" {
            break;
        }
    }
    let path = first.split(' ').nth(1).unwrap_or_default();
    if path.starts_with("/api/") {
        write!(
            stream,
            "HTTP/1.1 200 OK\r\nContent-Type: application/json\r\nContent-Length: {}\r\nConnection: close\r\n\r\n",
            listing.len()
        )?;
        return stream.write_all(listing);
    }
    let end = CONTENT.len() - 1;
    write!(
        stream,
        "HTTP/1.1 206 Partial Content\r\nContent-Length: {}\r\nContent-Range: bytes 0-{end}/{}\r\nETag: \"{COMMIT}\"\r\n\
         X-Repo-Commit: {COMMIT}\r\nConnection: close\r\n\r\n",
        CONTENT.len(),
        CONTENT.len()
    )?;
    stream.write_all(CONTENT)
}
