//! Large files: [Git LFS' batch API](https://github.com/git-lfs/git-lfs/blob/main/docs/api/batch.md) names those that the Hub lacks. Each
//! goes to its address by one PUT (LFS' transfer "basic"), at most 5 GB on the Hub.

use crate::hub::client::{Client, Sent};
use crate::hub::error::{Failure, PublishError};
use crate::hub::local_file::LocalFile;
use serde::Deserialize;
use serde_json::{json, Value};
use std::collections::BTreeMap;
use std::fs::File;

const TYPE: &str = "application/vnd.git-lfs+json";

#[derive(Deserialize)]
struct LfsBatch {
    objects: Vec<Object>,
}

#[derive(Deserialize)]
struct Object {
    oid: String,
    error: Option<ObjectError>,
    actions: Option<Actions>,
}

#[derive(Deserialize)]
struct ObjectError {
    code: u16,
    message: String,
}

#[derive(Deserialize)]
struct Actions {
    upload: Option<LfsAction>,
    verify: Option<LfsAction>,
}

#[derive(Deserialize)]
struct LfsAction {
    href: String,
    #[serde(default)]
    header: BTreeMap<String, Value>,
}

/// Uploads those of `files` that the Hub lacks; returns how many.
///
/// # Errors
/// See [`Failure`].
pub fn upload(client: &Client, files: &[&LocalFile]) -> Result<usize, Failure> {
    if files.is_empty() {
        return Ok(0);
    }
    let what = "asking which large files the Hub lacks";
    let objects = files
        .iter()
        .map(|file| json!({ "oid": file.sha256, "size": file.size }));
    let batch = json!({
        "operation": "upload",
        "transfers": ["basic"],
        "objects": objects.collect::<Vec<_>>(),
        "hash_algo": "sha256",
        "ref": { "name": "main" },
    });
    let target = client.target;
    let url = format!(
        "{}/{}.git/info/lfs/objects/batch",
        target.endpoint, target.repository
    );
    let answer = client.post(&Sent {
        what,
        url: &url,
        content_type: TYPE,
        body: batch.to_string().as_bytes(),
    })?;
    let batch: LfsBatch = client.json(what, answer)?;
    let mut uploaded = 0;
    for file in files {
        let found = batch.objects.iter().find(|one| one.oid == file.sha256);
        let Some(object) = found else {
            return Err(client.unusable(what, format!("it lacks {}", file.name)));
        };
        if let Some(error) = &object.error {
            return Err(Failure::Final(PublishError::Refused {
                endpoint: target.endpoint.clone(),
                what: format!("the file {}", file.name),
                status: error.code,
                reported: error.message.clone(),
            }));
        }
        // Without actions, the Hub has it.
        if let Some(actions) = &object.actions {
            uploaded += usize::from(upload_one(client, file, actions)?);
        }
    }
    Ok(uploaded)
}

fn upload_one(client: &Client, file: &LocalFile, actions: &Actions) -> Result<bool, Failure> {
    let Some(upload) = &actions.upload else {
        return Ok(false);
    };
    let what = format!("uploading {} ({} bytes)", file.name, file.size);
    if upload.header.contains_key("chunk_size") {
        let why = "it asks for an upload in parts, which was not offered".into();
        return Err(client.unusable(&what, why));
    }
    let headers: Vec<_> = upload
        .header
        .iter()
        .filter_map(|(name, value)| Some((name.clone(), value.as_str()?.to_owned())))
        .collect();
    let content = File::open(&file.path).map_err(PublishError::at(&file.path))?;
    tracing::info!("{what}");
    let answer = client.put(&what, &upload.href, &headers, &content)?;
    if answer.status().as_u16() == 403 {
        // The address has expired.
        let why = "the storage does not take it (HTTP 403)".into();
        return Err(Failure::Temporary { what, why });
    }
    client.succeeded(&what, answer)?;
    let Some(verify) = &actions.verify else {
        return Ok(true);
    };
    if !verify
        .href
        .starts_with(&format!("{}/", client.target.endpoint))
    {
        // Only the Hub may see the token.
        let why = format!("it asks to verify the file at {}", verify.href);
        return Err(client.unusable(&what, why));
    }
    let what = format!("verifying the upload of {}", file.name);
    let body = json!({ "oid": file.sha256, "size": file.size }).to_string();
    let answer = client.post(&Sent {
        what: &what,
        url: &verify.href,
        content_type: TYPE,
        body: body.as_bytes(),
    })?;
    client.succeeded(&what, answer)?;
    Ok(true)
}
