//! Why a recording could not be fetched.

use std::path::PathBuf;

use crate::hub::recording::HubRecording;

/// Why a recording could not be fetched, and the remedy.
#[derive(Debug, thiserror::Error)]
pub enum HubError {
    /// The text names no repository.
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
    /// The repository or revision does not exist.
    #[error("{recording} at {endpoint}: no such dataset or revision (HTTP 404); check the name")]
    NotFound {
        recording: HubRecording,
        endpoint: String,
    },
    /// The Hub cannot be reached.
    #[error("{recording}: {endpoint} cannot be asked: {cause}; is there a network?")]
    Unreachable {
        recording: HubRecording,
        endpoint: String,
        cause: String,
    },
    /// The repository is not a recording.
    #[error("{recording} has no meta/info.json; is it a LeRobotDataset?")]
    NoDataset { recording: HubRecording },
    /// The Hub's answer is unclear, or would make this program write outside the cache.
    #[error("{recording}: the Hub's listing is unusable: {cause}")]
    Listing {
        recording: HubRecording,
        cause: String,
    },
    /// The recording is listed for all, but its files are only for those its owner admits.
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
    /// The cache's folder refuses the download.
    #[error("{}: the Hub's cache cannot be written: {cause}; set HF_HOME to a folder that can be written, with room", folder.display())]
    Cache { folder: PathBuf, cause: String },
    /// The connection failed; whole files were kept.
    #[error(
        "{recording}: {file}: {cause}; run the command again, it keeps the files that are complete"
    )]
    Download {
        recording: HubRecording,
        file: String,
        cause: String,
    },
    /// The Hub sends another file than listed.
    #[error(
        "{recording}: {file}: {cause}; the Hub, or what is between, does not send what it lists"
    )]
    OtherFile {
        recording: HubRecording,
        file: String,
        cause: String,
    },
}
