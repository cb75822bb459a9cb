//! Fetches a recording into the cache.

use std::path::{Path, PathBuf};

use hf_hub::api::sync::{Api, ApiBuilder};
use hf_hub::{Cache, Repo, RepoType};

use crate::dataset::{CameraStorage, Info};
use crate::hub::download::{download, is_whole, DownloadFailure, HubProgress, RETRIES};
use crate::hub::error::HubError;
use crate::hub::listing::{is_hash, list, tagged, Listing, RemoteFile};
use crate::hub::name::DEFAULT_REVISION;
use crate::hub::options::HubOptions;
use crate::hub::recording::HubRecording;

/// The tag that LeRobot 0.4 to 0.6 read without a revision.
const LEROBOT_TAG: &str = "v3.0";

const INFO: &str = "meta/info.json";

/// A recording in the cache.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Fetched {
    /// Its folder.
    pub folder: PathBuf,
    /// Its commit.
    pub commit: String,
    /// The commit that LeRobot reads, if another: without a revision, LeRobot (0.6.1, `get_safe_version`) takes the tag `v3.0`, which may
    /// be older than `main`.
    pub lerobot_commit: Option<String>,
}

/// Fetches what is missing of a recording into the cache, and tells `progress` every step. If all is there, the Hub is asked only for the
/// listing and LeRobot's tag, and not at all for a fetched commit, which never changes. If the Hub cannot be reached, a recording in
/// the cache is used, with a warning.
///
/// # Errors
/// See [`HubError`]. Incomplete files do not get their names.
pub fn fetch(
    recording: &HubRecording,
    options: &HubOptions,
    progress: &mut dyn FnMut(HubProgress),
) -> Result<Fetched, HubError> {
    let api = build(recording, options)?;
    let cache = Cache::new(options.cache.clone());
    let of = |revision: &str| {
        Repo::with_revision(
            recording.repository.clone(),
            RepoType::Dataset,
            revision.into(),
        )
    };
    let named = cache.repo(of(&recording.revision));
    // The reference is written when everything is there.
    let before = match named.get(INFO).map(|info| in_cache(&info)) {
        Some(fetched) if is_hash(&recording.revision) => return Ok(fetched),
        before => before,
    };
    let mut listing = match list(&api.repo(of(&recording.revision)), recording, options) {
        Ok(listing) => listing,
        Err(error @ HubError::Unreachable { .. }) => {
            let fetched = before.ok_or(error)?;
            tracing::warn!(
                "{recording}: {} cannot be reached; what was fetched before is used",
                options.endpoint
            );
            return Ok(fetched);
        }
        Err(error) => return Err(error),
    };
    let pinned = of(&listing.sha);
    let snapshot = cache.repo(pinned.clone()).pointer_path(&listing.sha);
    let remote = api.repo(pinned.clone());
    let mut meter = HubProgress::default();
    let mut get = |file: &RemoteFile, all: &Listing| -> Result<(), HubError> {
        (meter.of_files, meter.of_bytes) = (all.siblings.len(), all.bytes());
        let path = snapshot.join(&file.rfilename);
        if !is_whole(&path, file.size) {
            let unfinished = cache.repo(pinned.clone()).blob_path(file.etag());
            let failed = |failure: DownloadFailure| failure.of(recording, options, &file.rfilename);
            download(&remote, file, &path, &unfinished, meter, progress).map_err(failed)?;
        }
        meter.files += 1;
        meter.bytes += file.size;
        progress(meter);
        Ok(())
    };
    // It names the recording's pictures.
    listing.begin_with(INFO);
    if let Some(info) = listing.siblings.first() {
        get(info, &listing)?;
    }
    listing.keep_pictures_of(&cameras_with_pictures(&snapshot));
    for file in listing.siblings.iter().skip(1) {
        get(file, &listing)?;
    }
    for reference in [named, cache.repo(pinned)] {
        if let Err(error) = reference.create_ref(&listing.sha) {
            tracing::warn!("{recording}: its place in the cache could not be noted: {error}");
        }
    }
    let lerobot_commit = if recording.revision == DEFAULT_REVISION {
        tagged(&api.repo(of(LEROBOT_TAG))).filter(|commit| *commit != listing.sha)
    } else {
        None
    };
    Ok(Fetched {
        folder: snapshot,
        commit: listing.sha,
        lerobot_commit,
    })
}

/// A recording of which this file is in the cache.
fn in_cache(info: &Path) -> Fetched {
    let folder = above(&above(info));
    let commit = folder.file_name().unwrap_or_default();
    Fetched {
        commit: commit.to_string_lossy().into_owned(),
        lerobot_commit: None,
        folder,
    }
}

/// Cameras whose pictures may be separate files; none if `meta/info.json` is unreadable, which opening the recording reports.
fn cameras_with_pictures(folder: &Path) -> Vec<String> {
    let cameras = Info::read(folder).map_or(Vec::new(), |info| info.cameras);
    let stored = cameras
        .into_iter()
        .filter(|camera| camera.storage == CameraStorage::Pictures);
    stored.map(|camera| camera.name).collect()
}

fn build(recording: &HubRecording, options: &HubOptions) -> Result<Api, HubError> {
    ApiBuilder::from_cache(Cache::new(options.cache.clone()))
        .with_endpoint(options.endpoint.trim_end_matches('/').into())
        .with_token(options.token.clone())
        .with_progress(false)
        .with_retries(RETRIES)
        .build()
        .map_err(|error| HubError::Unreachable {
            recording: recording.clone(),
            endpoint: options.endpoint.clone(),
            cause: error.to_string(),
        })
}

fn above(path: &Path) -> PathBuf {
    path.parent().unwrap_or(path).to_path_buf()
}
