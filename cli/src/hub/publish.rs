//! Publishes a folder.

use crate::hub::client::{Client, Sent};
use crate::hub::error::{Failure, PublishError};
use crate::hub::lfs;
use crate::hub::local_file::{files_of, LocalFile};
use crate::hub::target::{PublishTarget, RetryPolicy};
use base64::prelude::{Engine as _, BASE64_STANDARD};
use serde::Deserialize;
use serde_json::json;
use std::fs;
use std::path::Path;
use std::thread::sleep;

/// Most bytes of files within a commit. Files from 10 MB are large.
const MAX_INLINE: u64 = 64 << 20;

/// What was published.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PublishedCommit {
    /// The commit; `None` if nothing changed.
    pub commit: Option<String>,
    /// Files that the commit changes.
    pub changed: usize,
    /// Large files that were uploaded.
    pub uploaded: usize,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct PreuploadFile {
    path: String,
    upload_mode: UploadMode,
    #[serde(default)]
    should_ignore: bool,
    /// The repository's content.
    oid: Option<String>,
}

#[derive(Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
enum UploadMode {
    Lfs,
    Regular,
}

#[derive(Deserialize)]
struct Preupload {
    files: Vec<PreuploadFile>,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct CommitResponse {
    commit_oid: String,
}

/// Publishes the files of `folder` as the repository's newest commit. Temporary failures are retried.
///
/// # Errors
/// See [`PublishError`]. The repository is unchanged, or has the whole commit.
pub fn publish(
    target: &PublishTarget,
    folder: &Path,
    summary: &str,
) -> Result<PublishedCommit, PublishError> {
    let files = files_of(folder)?;
    let client = Client::new(target);
    let mut uploaded = 0;
    let committed = patiently(target.patience, || {
        once(&client, &files, summary, &mut uploaded)
    })?;
    let (commit, changed) = committed.map_or((None, 0), |(commit, files)| (Some(commit), files));
    Ok(PublishedCommit {
        commit,
        changed,
        uploaded,
    })
}

/// Until `attempt` succeeds or fails for good.
fn patiently<T>(
    patience: RetryPolicy,
    mut attempt: impl FnMut() -> Result<T, Failure>,
) -> Result<T, PublishError> {
    let mut wait = patience.first_wait;
    let mut tries = 1;
    loop {
        let (what, why) = match attempt() {
            Ok(value) => return Ok(value),
            Err(Failure::Final(error)) => return Err(error),
            Err(Failure::Temporary { what, why }) => (what, why),
        };
        if tries >= patience.tries {
            return Err(PublishError::Unavailable { what, tries, why });
        }
        tracing::warn!("{what} failed: {why}; trying again in {wait:?}");
        sleep(wait);
        wait = wait.saturating_mul(2);
        tries += 1;
    }
}

struct FileChange<'f> {
    file: &'f LocalFile,
    /// For the large files' storage.
    large: bool,
}

/// Each step can be repeated: it skips what is done.
fn once(
    client: &Client,
    files: &[LocalFile],
    summary: &str,
    uploaded: &mut usize,
) -> Result<Option<(String, usize)>, Failure> {
    create(client)?;
    let changes = changes(client, files)?;
    if changes.is_empty() {
        return Ok(None);
    }
    let large = changes.iter().filter(|change| change.large);
    let large: Vec<_> = large.map(|change| change.file).collect();
    *uploaded += lfs::upload(client, &large)?;
    let commit = commit(client, &changes, summary)?;
    Ok(Some((commit, changes.len())))
}

fn create(client: &Client) -> Result<(), Failure> {
    let what = "creating the repository";
    let target = client.target;
    let mut body = json!({
        "name": target.repository.name,
        "organization": target.repository.owner,
        "type": "model",
    });
    if target.private {
        body["private"] = true.into();
    }
    let url = format!("{}/api/repos/create", target.endpoint);
    let answer = client.post_json(what, &url, &body)?;
    match answer.status().as_u16() {
        // It exists.
        409 => Ok(()),
        // A token may write to an existing repository without the right to create one. The Hub answers 401 to a token for that repository
        // alone, 403 without the right, and 402 where the account would have to pay (`create_repo` of huggingface_hub 1.33).
        401..=403 if client.status(what, &client.model(""))?.is_success() => Ok(()),
        _ => client.succeeded(what, answer).map(drop),
    }
}

fn changes<'f>(client: &Client, files: &'f [LocalFile]) -> Result<Vec<FileChange<'f>>, Failure> {
    let what = "asking how files are to be uploaded";
    let asked = files.iter().map(|file| {
        json!({
            "path": file.name,
            "sample": BASE64_STANDARD.encode(&file.sample),
            "size": file.size,
        })
    });
    let body = json!({ "files": asked.collect::<Vec<_>>() });
    let answer = client.post_json(what, &client.model("/preupload/main"), &body)?;
    let found: Preupload = client.json(what, answer)?;
    let mut changes = Vec::new();
    for file in files {
        let Some(mode) = found.files.iter().find(|mode| mode.path == file.name) else {
            return Err(client.unusable(what, format!("it lacks {}", file.name)));
        };
        // The large files' storage takes no empty ones.
        let large = mode.upload_mode == UploadMode::Lfs && file.size > 0;
        let here = if large { &file.sha256 } else { &file.git_sha1 };
        // The repository's .gitignore may exclude a file.
        if !mode.should_ignore && mode.oid.as_ref() != Some(here) {
            changes.push(FileChange { file, large });
        }
    }
    Ok(changes)
}

/// Commits all changes or none; returns the commit's id.
fn commit(client: &Client, changes: &[FileChange], summary: &str) -> Result<String, Failure> {
    let what = "the commit";
    let inline = changes.iter().filter(|change| !change.large);
    let bytes: u64 = inline.map(|change| change.file.size).sum();
    if bytes > MAX_INLINE {
        let why = format!("it asks for {bytes} bytes within the commit");
        return Err(client.unusable(what, why));
    }
    let header = json!({ "key": "header", "value": { "summary": summary, "description": "" } });
    let mut lines = vec![header.to_string()];
    for FileChange { file, large } in changes {
        let line = if *large {
            json!({ "key": "lfsFile", "value": {
                "path": file.name, "algo": "sha256", "oid": file.sha256, "size": file.size,
            }})
        } else {
            let content = fs::read(&file.path).map_err(PublishError::at(&file.path))?;
            json!({ "key": "file", "value": {
                "content": BASE64_STANDARD.encode(content), "path": file.name, "encoding": "base64",
            }})
        };
        lines.push(line.to_string());
    }
    let answer = client.post(&Sent {
        what,
        url: &client.model("/commit/main"),
        content_type: "application/x-ndjson",
        body: lines.join("\n").as_bytes(),
    })?;
    let committed: CommitResponse = client.json(what, answer)?;
    Ok(committed.commit_oid)
}
