//! What the S3 server needs to stand for one of Google Cloud Storage, whose XML protocol has the requests of S3 with other names for some headers.
//! No emulator that a package registry has speaks that protocol whole.

use super::failing_network::Translation;
use crate::skipped::skipped;
use std::process::Command;
use std::sync::OnceLock;

/// Makes Google's protocol of what the S3 server speaks.
pub const TO_S3: Translation = Translation { request, answer };

fn request(head: &str) -> String {
    let mut lines = head.lines();
    let first = without_signature(lines.next().unwrap_or_default());
    // The server asks nobody who he is.
    let lines = lines.filter(|line| !line.starts_with("authorization:"));
    let renamed = lines.map(|line| match line.split_once(':') {
        Some(("x-goog-copy-source", source)) => format!("x-amz-copy-source:{source}"),
        // There is no object of the generation 0.
        Some(("x-goog-if-generation-match", _)) => "if-none-match: *".to_owned(),
        _ => line.to_owned(),
    });
    let lines: Vec<_> = [first].into_iter().chain(renamed).collect();
    lines.join("\r\n")
}

/// Google's answers have an `ETag`, which the server's do not always have.
fn answer(head: &str) -> String {
    if head
        .lines()
        .any(|line| line.to_lowercase().starts_with("etag:"))
    {
        head.to_owned()
    } else {
        format!("{head}\r\netag: \"1\"")
    }
}

/// The first line of a request without the signature of an address, which S3 has under other names.
fn without_signature(line: &str) -> String {
    match line.split_once("?X-Goog-Algorithm=") {
        Some((path, _)) => format!("{path} HTTP/1.1"),
        None => line.to_owned(),
    }
}

/// A key of a service account, as PEM. `None` if there is no program that makes one.
pub fn key() -> Option<&'static str> {
    static KEY: OnceLock<Option<String>> = OnceLock::new();
    let key = KEY.get_or_init(|| {
        let made = Command::new("openssl")
            .args(["genpkey", "-algorithm", "RSA"])
            .output();
        let made = made.ok().filter(|made| made.status.success());
        if made.is_none() {
            skipped("there is no openssl, which makes a key of a service account");
        }
        Some(String::from_utf8(made?.stdout).unwrap())
    });
    key.as_deref()
}

/// What tells a client where the server is, and who the client is.
pub fn variables(address: &str) -> Vec<(String, String)> {
    let key = key().unwrap().replace('\n', "\\n");
    let account = format!(
        r#"{{"private_key": "{key}", "private_key_id": "1", "client_email": "zk0@example.com"}}"#
    );
    [
        ("GOOGLE_SERVICE_ACCOUNT_KEY", &*account),
        ("GOOGLE_BASE_URL", address),
        ("GOOGLE_ALLOW_HTTP", "true"),
    ]
    .map(|(name, value)| (name.to_owned(), value.to_owned()))
    .into()
}
