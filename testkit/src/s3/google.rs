//! Lets the S3 server stand for Google Cloud Storage, whose XML protocol differs in some header names. No emulator in a package registry
//! speaks it whole.

use super::failing_network::Translation;
use crate::skipped::skipped;
use std::process::Command;
use std::sync::OnceLock;

/// From Google's protocol to S3's.
pub const TO_S3: Translation = Translation { request, answer };

fn request(head: &str) -> String {
    let mut lines = head.lines();
    let first = without_signature(lines.next().unwrap_or_default());
    // The server checks no identity.
    let lines = lines.filter(|line| !line.starts_with("authorization:"));
    let renamed = lines.map(|line| match line.split_once(':') {
        Some(("x-goog-copy-source", source)) => format!("x-amz-copy-source:{source}"),
        // Generation 0 has no object.
        Some(("x-goog-if-generation-match", _)) => "if-none-match: *".to_owned(),
        _ => line.to_owned(),
    });
    let lines: Vec<_> = [first].into_iter().chain(renamed).collect();
    lines.join("\r\n")
}

/// Google's answers have an `ETag`; the server's may not.
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

/// Without the URL's signature, which S3 names differently.
fn without_signature(line: &str) -> String {
    match line.split_once("?X-Goog-Algorithm=") {
        Some((path, _)) => format!("{path} HTTP/1.1"),
        None => line.to_owned(),
    }
}

/// A service account's key as PEM, if a program can make one.
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

/// A client's variables.
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
