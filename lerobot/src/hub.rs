//! Recordings from the Hugging Face Hub, through `hf-hub`: listed, downloaded into its cache, opened from there.
//!
//! The cache is the one that Python's `huggingface_hub` uses, laid out alike. A recording is pinned to the commit that its
//! revision names when it is fetched; every file is checked against the size, and large ones against the SHA-256, that the Hub lists.

use std::fs::{self, File};
use std::io;
use std::panic::{catch_unwind, AssertUnwindSafe};
use std::path::{Component, Path, PathBuf};
use std::str::FromStr;
use std::time::Duration;

use hf_hub::api::sync::{Api, ApiBuilder, ApiError, ApiRepo};
use hf_hub::{Cache, Repo, RepoType};
use serde::Deserialize;
use sha2::{Digest, Sha256};

/// Largest listing of a repository read, in bytes: some hundred thousand files.
const MAX_LISTING: u64 = 64 << 20;
/// How often a download is resumed where it broke off, and how often it starts again from the beginning.
const RETRIES: usize = 3;
const LISTING_TIMEOUT: Duration = Duration::from_secs(120);
/// The branch that is read where no revision is named.
const DEFAULT_REVISION: &str = "main";
/// The tag that LeRobot 0.4 to 0.6 read where no revision is named.
const LEROBOT_TAG: &str = "v3.0";
/// The folders that a recording is read from; all else in a repository stays there.
const FOLDERS: [&str; 3] = ["meta/", "data/", "videos/"];

/// Which recording: `owner/name`, or `owner/name@revision` for another branch, tag or commit than `main`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct HubRecording {
    /// `owner/name`.
    pub repository: String,
    /// Branch, tag or commit.
    pub revision: String,
}

impl FromStr for HubRecording {
    type Err = HubError;

    fn from_str(given: &str) -> Result<Self, HubError> {
        let (repository, revision) = given.split_once('@').unwrap_or((given, DEFAULT_REVISION));
        let plain = |part: &str| {
            !part.is_empty()
                && !part.contains("..")
                && part
                    .bytes()
                    .all(|b| b.is_ascii_alphanumeric() || b"._-".contains(&b))
        };
        let is_repository = repository
            .split_once('/')
            .is_some_and(|(owner, name)| plain(owner) && plain(name));
        if !is_repository || !revision.split('/').all(plain) {
            return Err(HubError::Name {
                given: given.into(),
            });
        }
        Ok(Self {
            repository: repository.into(),
            revision: revision.into(),
        })
    }
}

impl std::fmt::Display for HubRecording {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        write!(f, "{}@{}", self.repository, self.revision)
    }
}

/// Where the Hub is, who asks, and where files are kept.
#[derive(Debug, Clone)]
pub struct HubOptions {
    /// Address of the Hub.
    pub endpoint: String,
    /// Access token, for private recordings.
    pub token: Option<String>,
    /// The cache's folder.
    pub cache: PathBuf,
}

impl HubOptions {
    /// What the environment says: `HF_ENDPOINT`; `HF_TOKEN`, else the token that `hf auth login` left; `HF_HOME`, whose `hub` is
    /// the cache (`~/.cache/huggingface` without it).
    ///
    /// # Errors
    /// [`HubError::NoHome`].
    pub fn from_env() -> Result<Self, HubError> {
        let var = |name: &str| std::env::var(name).ok().filter(|v| !v.trim().is_empty());
        let cache = match var("HF_HOME") {
            Some(home) => Cache::new(PathBuf::from(home).join("hub")),
            // `hf_hub` would panic on such a name.
            None if std::env::home_dir().is_none() => return Err(HubError::NoHome),
            None => Cache::default(),
        };
        Ok(Self {
            endpoint: var("HF_ENDPOINT").unwrap_or_else(|| "https://huggingface.co".into()),
            token: var("HF_TOKEN").or_else(|| cache.token()),
            cache: cache.path().clone(),
        })
    }
}

/// How far a download is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct HubProgress {
    /// Files that are here.
    pub files: usize,
    /// Files of the recording.
    pub of_files: usize,
    /// Bytes that are here.
    pub bytes: u64,
    /// Bytes of the recording.
    pub of_bytes: u64,
}

/// Why a recording could not be fetched, and what to do.
#[derive(Debug, thiserror::Error)]
pub enum HubError {
    /// The text is not the name of a repository.
    #[error(
        "{given:?} does not name a recording on the Hub; write owner/name or owner/name@revision"
    )]
    Name { given: String },
    /// There is no folder for the cache.
    #[error("there is no home directory to keep downloads in; set HF_HOME")]
    NoHome,
    /// The Hub does not show it to this caller; private and missing repositories look alike.
    #[error(
        "{recording} at {endpoint}: access refused (HTTP {status}); check the name, and set HF_TOKEN to a token that may read \
         it"
    )]
    Refused {
        recording: HubRecording,
        endpoint: String,
        status: u16,
    },
    /// There is no such repository or revision.
    #[error("{recording} at {endpoint}: no such dataset or revision (HTTP 404); check the name")]
    NotFound {
        recording: HubRecording,
        endpoint: String,
    },
    /// The Hub could not be asked.
    #[error("{recording}: {endpoint} cannot be asked: {cause}; is there a network?")]
    Unreachable {
        recording: HubRecording,
        endpoint: String,
        cause: String,
    },
    /// The repository is not a recording.
    #[error("{recording} has no meta/info.json; is it a LeRobotDataset?")]
    NoDataset { recording: HubRecording },
    /// The Hub's answer cannot be understood, or it would make this program write outside the cache.
    #[error("{recording}: the Hub's listing is unusable: {cause}")]
    Listing {
        recording: HubRecording,
        cause: String,
    },
    /// The recording is listed for everybody, and its files are for those whom its owner let in.
    #[error(
        "{recording}: access refused to {file} (HTTP {status}); ask for access at {page}, and set HF_TOKEN to a token of the account \
         that has it"
    )]
    Gated {
        recording: HubRecording,
        file: String,
        page: String,
        status: u16,
    },
    /// The cache's folder does not take what is downloaded.
    #[error("{}: the Hub's cache cannot be written: {cause}; set HF_HOME to a folder that can be written, with room", folder.display())]
    Cache { folder: PathBuf, cause: String },
    /// The connection failed, and what is whole was kept.
    #[error(
        "{recording}: {file}: {cause}; run the command again, it keeps the files that are complete"
    )]
    Download {
        recording: HubRecording,
        file: String,
        cause: String,
    },
    /// The Hub sends another file than it lists.
    #[error(
        "{recording}: {file}: {cause}; the Hub, or what is between, does not send what it lists"
    )]
    OtherFile {
        recording: HubRecording,
        file: String,
        cause: String,
    },
}

/// A recording in the cache.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Fetched {
    /// Its folder.
    pub folder: PathBuf,
    /// The commit that it is of.
    pub commit: String,
    /// The commit that LeRobot reads if it differs: without a revision, LeRobot (0.6.1, `get_safe_version`) takes the tag `v3.0`, which
    /// may be older than `main`.
    pub lerobot_commit: Option<String>,
}

/// Fetches what is missing of a recording into the cache. `progress` is told of every step; if all is there, the
/// Hub is asked only for the listing and for LeRobot's tag. If the Hub cannot be reached, a recording that was fetched before is used as it is, with a warning.
///
/// # Errors
/// See [`HubError`]. A file that is not whole is not left under its name.
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
    let listing = match list(&api.repo(of(&recording.revision)), recording, options) {
        Ok(listing) => listing,
        Err(error @ HubError::Unreachable { .. }) => {
            // The reference is written when everything is there.
            let info = named.get("meta/info.json").ok_or(error)?;
            tracing::warn!(
                "{recording}: {} cannot be reached; what was fetched before is used",
                options.endpoint
            );
            let folder = above(&above(&info));
            let commit = folder.file_name().unwrap_or_default();
            return Ok(Fetched {
                commit: commit.to_string_lossy().into_owned(),
                lerobot_commit: None,
                folder,
            });
        }
        Err(error) => return Err(error),
    };
    let pinned = of(&listing.sha);
    let snapshot = cache.repo(pinned.clone()).pointer_path(&listing.sha);
    let remote = api.repo(pinned.clone());
    let mut meter = HubProgress {
        files: 0,
        of_files: listing.siblings.len(),
        bytes: 0,
        of_bytes: listing
            .siblings
            .iter()
            .fold(0, |sum: u64, file| sum.saturating_add(file.size)),
    };
    for file in &listing.siblings {
        let path = snapshot.join(&file.rfilename);
        if !is_whole(&path, file.size) {
            let unfinished = cache.repo(pinned.clone()).blob_path(file.etag());
            let failed = |failure: Failure| failure.of(recording, options, &file.rfilename);
            download(&remote, file, &path, &unfinished, meter, progress).map_err(failed)?;
        }
        meter.files += 1;
        meter.bytes += file.size;
        progress(meter);
    }
    if let Err(error) = named.create_ref(&listing.sha) {
        tracing::warn!("{recording}: its place in the cache could not be noted: {error}");
    }
    let lerobot_commit = match recording.revision == DEFAULT_REVISION {
        true => tagged(&api.repo(of(LEROBOT_TAG))).filter(|commit| *commit != listing.sha),
        false => None,
    };
    Ok(Fetched {
        folder: snapshot,
        commit: listing.sha,
        lerobot_commit,
    })
}

/// The commit that a tag names; `None` if there is no such tag, or the Hub does not answer: nothing depends on it but a warning.
fn tagged(repo: &ApiRepo) -> Option<String> {
    let request = repo.info_request().config();
    let request = request.timeout_global(Some(LISTING_TIMEOUT)).build();
    let mut response = request.call().ok()?;
    let body = response.body_mut().with_config().limit(MAX_LISTING);
    let commit: Commit = body.read_json().ok()?;
    is_hash(&commit.sha).then_some(commit.sha)
}

/// Whether it is a digest as git or Git LFS writes it.
fn is_hash(text: &str) -> bool {
    text.len() >= 40 && text.bytes().all(|b| b.is_ascii_hexdigit())
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

/// Of the Hub's answer, what is needed.
#[derive(Deserialize)]
struct Listing {
    sha: String,
    siblings: Vec<RemoteFile>,
}

#[derive(Deserialize)]
struct Commit {
    sha: String,
}

#[derive(Deserialize)]
struct RemoteFile {
    rfilename: String,
    size: u64,
    #[serde(rename = "blobId")]
    blob_id: String,
    lfs: Option<LargeFile>,
}

#[derive(Deserialize)]
struct LargeFile {
    sha256: String,
}

impl RemoteFile {
    /// The name of the file's content in the cache.
    fn etag(&self) -> &str {
        self.lfs.as_ref().map_or(&self.blob_id, |lfs| &lfs.sha256)
    }
}

/// Commit and files of the recording, checked to be safe as paths.
fn list(
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
    listing
        .siblings
        .retain(|file| FOLDERS.iter().any(|f| file.rfilename.starts_with(f)));
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

fn is_whole(path: &Path, size: u64) -> bool {
    fs::metadata(path).is_ok_and(|found| found.is_file() && found.len() == size)
}

/// Why a file was not downloaded.
enum Failure {
    /// It may go better later.
    Connection(String),
    /// The Hub does not give it to this caller.
    Refused(u16),
    /// The cache's folder does not take it.
    Cache(String),
    /// What came is not what is listed.
    Other(String),
}

impl Failure {
    fn of(self, recording: &HubRecording, options: &HubOptions, file: &str) -> HubError {
        let (recording, file) = (recording.clone(), file.to_owned());
        match self {
            Self::Refused(status) => HubError::Gated {
                page: format!("{}/datasets/{}", options.endpoint, recording.repository),
                recording,
                file,
                status,
            },
            Self::Cache(cause) => HubError::Cache {
                folder: options.cache.clone(),
                cause,
            },
            Self::Connection(cause) => HubError::Download {
                recording,
                file,
                cause,
            },
            Self::Other(cause) => HubError::OtherFile {
                recording,
                file,
                cause,
            },
        }
    }

    fn from_api(error: ApiError) -> Self {
        match error {
            ApiError::TooManyRetries(error) => Self::from_api(*error),
            ApiError::RequestError(error) => match *error {
                ureq::Error::StatusCode(status @ (401 | 403)) => Self::Refused(status),
                ureq::Error::StatusCode(status @ (400 | 404 | 410)) => {
                    Self::Other(format!("HTTP {status}"))
                }
                error => Self::Connection(error.to_string()),
            },
            ApiError::LockAcquisition(lock) => Self::Connection(format!(
                "another process is downloading it ({} is locked)",
                lock.display()
            )),
            ApiError::IoError(error) if is_local(error.kind()) => Self::Cache(error.to_string()),
            error => Self::Connection(error.to_string()),
        }
    }
}

/// Whether it is the disk that fails. A connection that breaks is an I/O error, too.
fn is_local(kind: io::ErrorKind) -> bool {
    matches!(
        kind,
        io::ErrorKind::PermissionDenied
            | io::ErrorKind::ReadOnlyFilesystem
            | io::ErrorKind::StorageFull
            | io::ErrorKind::QuotaExceeded
            | io::ErrorKind::NotADirectory
            | io::ErrorKind::NotFound
    )
}

/// Downloads one file and checks it. The download starts again when the connection breaks, or the content is not what the Hub listed.
fn download(
    remote: &ApiRepo,
    file: &RemoteFile,
    path: &Path,
    blob: &Path,
    meter: HubProgress,
    progress: &mut dyn FnMut(HubProgress),
) -> Result<(), Failure> {
    let mut last = Failure::Other("was not asked for".into());
    for _ in 0..RETRIES {
        // An earlier attempt left the whole file, or more. There is nothing to resume, and the Hub would refuse the request.
        let part = blob.with_extension("part");
        if fs::metadata(&part).is_ok_and(|found| found.len() >= file.size) {
            remove(&part)?;
        }
        remove(path)?;
        let watch = Watch {
            meter,
            progress: &mut *progress,
        };
        let done = catch_unwind(AssertUnwindSafe(|| {
            remote.download_with_progress(&file.rfilename, watch)
        }));
        last = match done {
            Ok(Ok(_)) => match check(path, file)? {
                None => return Ok(()),
                Some(cause) => {
                    remove(path)?;
                    remove(blob)?;
                    Failure::Other(cause)
                }
            },
            Ok(Err(error @ ApiError::LockAcquisition(_))) => return Err(Failure::from_api(error)),
            Ok(Err(error)) => match Failure::from_api(error) {
                failure @ Failure::Connection(_) => failure,
                failure => return Err(failure),
            },
            Err(_) => Failure::Other("the Hub's answer lacks what an answer has to have".into()),
        };
    }
    Err(last)
}

/// How a file differs from what the Hub lists.
fn check(path: &Path, file: &RemoteFile) -> Result<Option<String>, Failure> {
    let unreadable = |e: io::Error| Failure::Cache(format!("{}: {e}", path.display()));
    let size = fs::metadata(path).map_err(unreadable)?.len();
    if size != file.size {
        let cause = format!("{size} bytes came where {} are listed", file.size);
        return Ok(Some(cause));
    }
    let Some(lfs) = &file.lfs else {
        return Ok(None);
    };
    let mut hash = Sha256::new();
    let mut content = File::open(path).map_err(unreadable)?;
    io::copy(&mut content, &mut hash).map_err(unreadable)?;
    let found = hex::encode(hash.finalize());
    Ok(match found.eq_ignore_ascii_case(&lfs.sha256) {
        true => None,
        false => Some(format!(
            "its SHA-256 is {found} where {} is listed",
            lfs.sha256
        )),
    })
}

fn remove(path: &Path) -> Result<(), Failure> {
    match fs::remove_file(path) {
        // Where a folder of the path is a file, nothing can be written, and the download states so.
        Err(e)
            if !matches!(
                e.kind(),
                io::ErrorKind::NotFound | io::ErrorKind::NotADirectory
            ) =>
        {
            Err(Failure::Cache(format!("{}: {e}", path.display())))
        }
        _ => Ok(()),
    }
}

fn above(path: &Path) -> PathBuf {
    path.parent().unwrap_or(path).to_path_buf()
}

/// Adds the bytes of the file that is coming to what is here.
struct Watch<'a> {
    meter: HubProgress,
    progress: &'a mut dyn FnMut(HubProgress),
}

impl hf_hub::api::Progress for Watch<'_> {
    fn init(&mut self, _size: usize, _filename: &str) {}

    fn update(&mut self, size: usize) {
        self.meter.bytes = (self.meter.bytes + size as u64).min(self.meter.of_bytes);
        (self.progress)(self.meter);
    }

    fn finish(&mut self) {}
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_recordings() {
        let parse = |given: &str| {
            given
                .parse::<HubRecording>()
                .map(|r| (r.repository, r.revision))
        };
        let pair = |a: &str, b: &str| Some((a.to_owned(), b.to_owned()));
        assert_eq!(
            parse("lerobot/svla_so100").ok(),
            pair("lerobot/svla_so100", "main")
        );
        assert_eq!(parse("a/b@v2.1").ok(), pair("a/b", "v2.1"));
        assert_eq!(parse("a/b@refs/convert").ok(), pair("a/b", "refs/convert"));
        for wrong in [
            "", "a", "a/", "/b", "a/b/c", "../b", "a/..", "a/b@", "a/b@../x", "a b/c", "a/b?x",
        ] {
            assert!(parse(wrong).is_err(), "{wrong}");
        }
    }
}
