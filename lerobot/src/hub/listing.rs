//! The Hub's listing of a recording: commit, files, sizes, digests.

use std::path::{Component, Path};
use std::time::Duration;

use hf_hub::api::sync::ApiRepo;
use serde::Deserialize;

use crate::hub::error::HubError;
use crate::hub::options::HubOptions;
use crate::hub::recording::HubRecording;

/// Largest repository listing, in bytes: some hundred thousand files.
const MAX_LISTING: u64 = 64 << 20;
const LISTING_TIMEOUT: Duration = Duration::from_secs(120);
/// Folders of a recording; all else in a repository is not fetched.
const FOLDERS: [&str; 3] = ["meta/", "data/", "videos/"];
/// LeRobot's folder of pictures outside videos and tables. A killed process leaves pictures there, too.
const PICTURES: &str = "images/";
/// Largest picture file fetched, and the largest read.
const MAX_PICTURE: u64 = 64 << 20;

#[derive(Deserialize)]
pub(super) struct Listing {
    pub sha: String,
    pub siblings: Vec<RemoteFile>,
}

#[derive(Deserialize)]
struct CommitInfo {
    sha: String,
}

#[derive(Deserialize)]
pub(super) struct RemoteFile {
    pub rfilename: String,
    pub size: u64,
    #[serde(rename = "blobId")]
    blob_id: String,
    pub lfs: Option<LargeFile>,
}

#[derive(Deserialize)]
pub(super) struct LargeFile {
    pub sha256: String,
}

impl RemoteFile {
    /// The content's name in the cache.
    pub fn etag(&self) -> &str {
        self.lfs.as_ref().map_or(&self.blob_id, |lfs| &lfs.sha256)
    }
}

/// The recording's commit and files, checked to be safe paths.
pub(super) fn list(
    repo: &ApiRepo,
    recording: &HubRecording,
    options: &HubOptions,
) -> Result<Listing, HubError> {
    let endpoint = options.endpoint.clone();
    let wrong = |cause: String| HubError::Listing {
        recording: recording.clone(),
        cause,
    };
    let failed = |error: ureq::Error| match error {
        ureq::Error::StatusCode(status @ (401 | 403)) => HubError::Refused {
            recording: recording.clone(),
            endpoint: endpoint.clone(),
            status,
        },
        ureq::Error::StatusCode(404) => HubError::NotFound {
            recording: recording.clone(),
            endpoint: endpoint.clone(),
        },
        ureq::Error::Json(error) => wrong(error.to_string()),
        other => HubError::Unreachable {
            recording: recording.clone(),
            endpoint: endpoint.clone(),
            cause: other.to_string(),
        },
    };
    let request = repo
        .info_request()
        .query("blobs", "true") // sizes and hashes
        .config()
        .timeout_global(Some(LISTING_TIMEOUT))
        .build();
    let mut response = request.call().map_err(failed)?;
    let body = response.body_mut().with_config().limit(MAX_LISTING);
    let mut listing: Listing = body.read_json().map_err(failed)?;

    if !is_hash(&listing.sha) {
        return Err(wrong(format!("{:?} is no commit", listing.sha)));
    }
    let folders = || FOLDERS.into_iter().chain([PICTURES]);
    listing
        .siblings
        .retain(|file| folders().any(|f| file.rfilename.starts_with(f)));
    for file in &listing.siblings {
        let inside = Path::new(&file.rfilename)
            .components()
            .all(|c| matches!(c, Component::Normal(_)));
        if !inside || !is_hash(file.etag()) {
            return Err(wrong(format!("file {:?}", file.rfilename)));
        }
    }
    if !listing
        .siblings
        .iter()
        .any(|file| file.rfilename == "meta/info.json")
    {
        return Err(HubError::NoDataset {
            recording: recording.clone(),
        });
    }
    Ok(listing)
}

impl Listing {
    pub fn begin_with(&mut self, name: &str) {
        let is_other = |file: &RemoteFile| file.rfilename != name;
        self.siblings.sort_by_key(is_other);
    }

    /// Removes files in `images/` except these cameras' pictures.
    pub fn keep_pictures_of(&mut self, cameras: &[String]) {
        self.siblings.retain(|file| {
            let Some(name) = file.rfilename.strip_prefix(PICTURES) else {
                return true;
            };
            let of_camera = |camera: &String| {
                let rest = name.strip_prefix(&camera[..]);
                rest.is_some_and(|rest| rest.starts_with('/'))
            };
            file.size <= MAX_PICTURE && cameras.iter().any(of_camera)
        });
    }

    pub fn bytes(&self) -> u64 {
        let sizes = self.siblings.iter().map(|file| file.size);
        sizes.fold(0, u64::saturating_add)
    }
}

/// A tag's commit; `None` without such a tag or an answer: only a warning depends on it.
pub(super) fn tagged(repo: &ApiRepo) -> Option<String> {
    let request = repo.info_request().config();
    let request = request.timeout_global(Some(LISTING_TIMEOUT)).build();
    let mut response = request.call().ok()?;
    let body = response.body_mut().with_config().limit(MAX_LISTING);
    let commit: CommitInfo = body.read_json().ok()?;
    is_hash(&commit.sha).then_some(commit.sha)
}

/// Whether it is a digest as git or Git LFS writes it.
pub(super) fn is_hash(text: &str) -> bool {
    text.len() >= 40 && text.bytes().all(|b| b.is_ascii_hexdigit())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pictures_of_other_cameras_and_huge_ones_stay_there() {
        let file = |(name, size): (&str, u64)| serde_json::json!({"rfilename": name, "size": size, "blobId": "", "lfs": null});
        let files = [
            ("data/file", MAX_PICTURE + 1),
            ("images/top/huge.png", MAX_PICTURE + 1),
            ("images/top/a.png", MAX_PICTURE),
            ("images/topmost/a.png", 1),
            ("images/a.png", 1),
        ];
        let siblings: Vec<_> = files.into_iter().map(file).collect();
        let listing = serde_json::json!({"sha": "", "siblings": siblings});
        let mut listing: Listing = serde_json::from_value(listing).unwrap();
        listing.keep_pictures_of(&["top".into()]);
        let names: Vec<_> = listing.siblings.iter().map(|f| &f.rfilename[..]).collect();
        assert_eq!(names, ["data/file", "images/top/a.png"]);
        listing.begin_with("images/top/a.png");
        assert_eq!(listing.siblings[0].rfilename, "images/top/a.png");
    }
}
