//! One file of a recording, downloaded and compared with the listing.

use std::fs::{self, File};
use std::io;
use std::panic::{catch_unwind, AssertUnwindSafe};
use std::path::Path;

use hf_hub::api::sync::{ApiError, ApiRepo};
use sha2::{Digest, Sha256};

use crate::hub::error::HubError;
use crate::hub::listing::RemoteFile;
use crate::hub::options::HubOptions;
use crate::hub::recording::HubRecording;

/// How often a broken download resumes, and how often it starts again.
pub(super) const RETRIES: usize = 3;

/// A download's progress.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct HubProgress {
    /// Files downloaded.
    pub files: usize,
    /// Files of the recording.
    pub of_files: usize,
    /// Bytes downloaded.
    pub bytes: u64,
    /// Bytes of the recording.
    pub of_bytes: u64,
}

pub(super) fn is_whole(path: &Path, size: u64) -> bool {
    fs::metadata(path).is_ok_and(|found| found.is_file() && found.len() == size)
}

pub(super) enum DownloadFailure {
    /// A retry may help.
    Connection(String),
    /// The Hub refuses this caller.
    Refused(u16),
    /// The cache's folder refuses it.
    Cache(String),
    /// The content is not as listed.
    Other(String),
}

impl DownloadFailure {
    pub fn of(self, recording: &HubRecording, options: &HubOptions, file: &str) -> HubError {
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

/// Whether the disk fails; broken connections are I/O errors, too.
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

/// Downloads and checks one file. Starts again when the connection breaks or the content is not as listed.
pub(super) fn download(
    remote: &ApiRepo,
    file: &RemoteFile,
    path: &Path,
    blob: &Path,
    meter: HubProgress,
    progress: &mut dyn FnMut(HubProgress),
) -> Result<(), DownloadFailure> {
    let mut last = DownloadFailure::Other("was not asked for".into());
    for _ in 0..RETRIES {
        // An earlier attempt left the whole file or more: the Hub would refuse to resume.
        let part = blob.with_extension("part");
        if fs::metadata(&part).is_ok_and(|found| found.len() >= file.size) {
            remove(&part)?;
        }
        remove(path)?;
        let watch = DownloadProgress {
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
                    DownloadFailure::Other(cause)
                }
            },
            Ok(Err(error @ ApiError::LockAcquisition(_))) => {
                return Err(DownloadFailure::from_api(error))
            }
            Ok(Err(error)) => match DownloadFailure::from_api(error) {
                failure @ DownloadFailure::Connection(_) => failure,
                failure => return Err(failure),
            },
            Err(_) => {
                DownloadFailure::Other("the Hub's answer lacks what an answer has to have".into())
            }
        };
    }
    Err(last)
}

fn check(path: &Path, file: &RemoteFile) -> Result<Option<String>, DownloadFailure> {
    let unreadable = |e: io::Error| DownloadFailure::Cache(format!("{}: {e}", path.display()));
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
    Ok(if found.eq_ignore_ascii_case(&lfs.sha256) {
        None
    } else {
        Some(format!(
            "its SHA-256 is {found} where {} is listed",
            lfs.sha256
        ))
    })
}

fn remove(path: &Path) -> Result<(), DownloadFailure> {
    match fs::remove_file(path) {
        // Where the path has a file for a folder, the download fails with that cause.
        Err(e)
            if !matches!(
                e.kind(),
                io::ErrorKind::NotFound | io::ErrorKind::NotADirectory
            ) =>
        {
            Err(DownloadFailure::Cache(format!("{}: {e}", path.display())))
        }
        _ => Ok(()),
    }
}

struct DownloadProgress<'a> {
    meter: HubProgress,
    progress: &'a mut dyn FnMut(HubProgress),
}

impl hf_hub::api::Progress for DownloadProgress<'_> {
    fn init(&mut self, _size: usize, _filename: &str) {}

    fn update(&mut self, size: usize) {
        self.meter.bytes = (self.meter.bytes + size as u64).min(self.meter.of_bytes);
        (self.progress)(self.meter);
    }

    fn finish(&mut self) {}
}
