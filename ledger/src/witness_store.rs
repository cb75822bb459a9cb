//! A witness' files: for each log, the last checkpoint that it cosigned, as the C2SP monitoring interface serves it. The file is on disk
//! before the cosignature leaves, so even a killed witness never forgets what it signed.

use sha2::{Digest as _, Sha256};
use std::collections::BTreeMap;
use std::fs::{File, TryLockError};
use std::io;
use std::path::{Path, PathBuf};
use zk0_files::atomic_file::{self, create_folder};
use zk0_files::bounded_file;
use zk0_protocol::tlog::checkpoint::{Checkpoint, Parsed, MAX_NOTE_BYTES};
use zk0_protocol::tlog::cosigner::{self, Cosigner};
use zk0_protocol::tlog::verifier_key::{Role, VerifierKey};
use zk0_protocol::tlog::witness::{AcceptedCheckpoint, Witness, WitnessRefusal};
use zk0_protocol::tlog::witness_policy::WitnessPolicy;

/// A witness and its folder.
pub struct WitnessStore {
    dir: PathBuf,
    witness: Witness,
    /// Each log's file by the log's name, to answer repeated requests.
    cosigned: BTreeMap<String, KeptCosignature>,
    /// Held while the witness runs: two processes in one folder could cosign two histories.
    _lock: File,
}

struct KeptCosignature {
    checkpoint: Checkpoint,
    /// The entry that gave the log the key that signed it.
    since: u64,
    /// The note's line.
    cosignature: Vec<u8>,
}

/// Why a witness cannot start or go on.
#[derive(Debug, thiserror::Error)]
pub enum WitnessError {
    /// The file system failed.
    #[error("{path}: {error}")]
    Io { path: PathBuf, error: io::Error },
    /// Another process uses the folder.
    #[error("the witness in {0} is running already: stop that process first")]
    Locked(PathBuf),
    /// A file is damaged. Without it, the witness could cosign a second history.
    #[error(
        "{path} does not hold the last checkpoint of the log '{origin}' that this witness cosigned: {why}. Restore the file"
    )]
    Damaged {
        path: PathBuf,
        origin: String,
        why: String,
    },
    /// The witness cannot watch a log.
    #[error("{0}")]
    Log(String),
}

/// Why a request gets no cosignature.
#[derive(Debug, thiserror::Error)]
pub enum AddError {
    /// The witness refuses.
    #[error(transparent)]
    Refused(#[from] WitnessRefusal),
    /// The checkpoint cannot be stored, so it is not cosigned.
    #[error(transparent)]
    Failed(#[from] WitnessError),
}

impl WitnessStore {
    /// Opens the witness in `dir` for `logs`, and verifies its files.
    pub fn open(
        dir: &Path,
        cosigner: Cosigner,
        logs: Vec<VerifierKey>,
    ) -> Result<Self, WitnessError> {
        // Without its folder, the witness would forget what it cosigned.
        create_folder(dir).map_err(io_error(dir))?;
        let path = dir.join("lock");
        let lock = File::create(&path).map_err(io_error(&path))?;
        lock.try_lock().map_err(|error| match error {
            TryLockError::WouldBlock => WitnessError::Locked(dir.into()),
            TryLockError::Error(error) => io_error(&path)(error),
        })?;
        let mut store = Self {
            dir: dir.into(),
            witness: Witness::new(cosigner),
            cosigned: BTreeMap::new(),
            _lock: lock,
        };
        for key in logs {
            let remembered = store.remembered(&key)?;
            let last = remembered.as_ref().map(|cosigned| cosigned.checkpoint);
            let since = remembered.as_ref().map_or(0, |cosigned| cosigned.since);
            if let Some(cosigned) = remembered {
                store.cosigned.insert(key.name().into(), cosigned);
            }
            let watched = store.witness.watch(key, last, since);
            watched.map_err(WitnessError::Log)?;
        }
        Ok(store)
    }

    fn remembered(&self, key: &VerifierKey) -> Result<Option<KeptCosignature>, WitnessError> {
        let path = self.file(key.name());
        let Some(text) = read(&path)? else {
            return Ok(None);
        };
        let damaged = |why: String| WitnessError::Damaged {
            path: path.clone(),
            origin: key.name().into(),
            why,
        };
        // The file must carry this witness' own cosignature.
        let own = format!("witness this {}\nquorum this\n", self.witness.key());
        let own = WitnessPolicy::parse(&own).map_err(|error| damaged(error.to_string()))?;
        let opened = own
            .open(&text, key)
            .map_err(|error| damaged(error.to_string()))?;
        let parsed = Parsed::read(&text).map_err(|error| damaged(error.to_string()))?;
        let signature = parsed.signed_by(key);
        let signature = signature.map_err(|error| damaged(error.to_string()))?;
        let own = cosigner::find(&text, self.witness.key(), &parsed.note);
        let own = own.ok_or_else(|| damaged("it has no cosignature of this witness".into()))?;
        Ok(Some(KeptCosignature {
            checkpoint: opened.checkpoint,
            since: signature.since,
            cosignature: own.to_bytes(),
        }))
    }

    /// Decides on a request at `time_s`, and returns the cosignature line. The checkpoint is then on disk. A repeated one gets its old
    /// cosignature without a write, because anyone can send a public checkpoint often.
    pub fn add(&mut self, body: &[u8], time_s: u64) -> Result<Vec<u8>, AddError> {
        let accepted = self.witness.check(body, time_s)?;
        match self.cosigned.get(&accepted.origin) {
            // A later key is remembered.
            Some(known)
                if known.checkpoint == accepted.checkpoint && known.since == accepted.since =>
            {
                return Ok(known.cosignature.clone());
            }
            _ => {}
        }
        self.write(&accepted)?;
        self.witness.record(&accepted);
        let cosigned = KeptCosignature {
            checkpoint: accepted.checkpoint,
            since: accepted.since,
            cosignature: accepted.cosignature.clone(),
        };
        self.cosigned.insert(accepted.origin, cosigned);
        Ok(accepted.cosignature)
    }

    /// The last cosigned checkpoint of the log whose origin has this SHA-256, in lower-case hexadecimal.
    pub fn last(&self, origin_hash: &str) -> Result<Option<Vec<u8>>, WitnessError> {
        let watched = |key: &VerifierKey| hash(key.name()) == origin_hash;
        match self.witness.logs().find(|key| watched(key)) {
            Some(key) => read(&self.file(key.name())),
            None => Ok(None),
        }
    }

    /// The logs that it has cosigned, with the size of each one's last checkpoint.
    pub fn sizes(&self) -> impl Iterator<Item = (&str, u64)> {
        let logs = self.cosigned.iter();
        logs.map(|(log, kept)| (log.as_str(), kept.checkpoint.size))
    }

    /// The key that verifies its cosignatures.
    pub fn key(&self) -> &VerifierKey {
        debug_assert_eq!(self.witness.key().role(), Role::Witness);
        self.witness.key()
    }

    fn write(&self, accepted: &AcceptedCheckpoint) -> Result<(), WitnessError> {
        let path = self.file(&accepted.origin);
        atomic_file::replace(&path, &accepted.note).map_err(io_error(&path))
    }

    fn file(&self, origin: &str) -> PathBuf {
        self.dir.join(hash(origin))
    }
}

fn read(path: &Path) -> Result<Option<Vec<u8>>, WitnessError> {
    bounded_file::start_if_there(path, MAX_NOTE_BYTES as u64 + 1).map_err(io_error(path))
}

/// A log's name in the monitoring interface: its origin's SHA-256, in hexadecimal.
pub fn hash(origin: &str) -> String {
    hex::encode(Sha256::digest(origin.as_bytes()))
}

fn io_error(path: &Path) -> impl FnOnce(io::Error) -> WitnessError + '_ {
    |error| WitnessError::Io {
        path: path.into(),
        error,
    }
}
