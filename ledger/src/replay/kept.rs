//! What a writer has verified, on disk: its next start replays only newer entries.
//!
//! The file `state` in the ledger's folder has a line with the format, what the log's key signs, and the content, in borsh. It counts only for the writer with that key, where the database has its tree. So somebody who can write the folder, and has no key
//! or a former one, can put no other state there: nothing of the content is read before the signature is verified, and no more than was
//! signed. It counts only for the build that wrote it, because another may have other rules. If it does not count, the log states why, and
//! the whole history is replayed. An audit reads all entries again.

use super::chunk::Chunk;
use super::saved::SavedError;
use super::verified::{HistoryFold, VerifiedHistory};
use crate::error::LedgerError;
use crate::folder;
use crate::store::Store;
use borsh::{BorshDeserialize, BorshSerialize};
use ed25519_dalek::SigningKey;
use sha2::{Digest as _, Sha256};
use std::fs::File;
use std::io::{self, BufReader, Read};
use std::path::{Path, PathBuf};
use std::sync::OnceLock;
use zk0_circuits::{Digest, NodeId};
use zk0_files::atomic_file::{self, Durability};
use zk0_files::bounded_file;
use zk0_protocol::entries::signed::{SignableStatement, Signed};
use zk0_protocol::rules::state::State;
use zk0_protocol::tlog::checkpoint::Checkpoint;
use zk0_protocol::tlog::tree::Frontier;
use zk0_protocol::{Body, Genesis};

const FORMAT: &[u8] = b"zk0 kept state v1\n";

/// A writer's verified state, for its next start.
pub struct KeptState {
    path: PathBuf,
    build: Digest,
    verified: VerifiedHistory,
    fold: Vec<u8>,
    key: SigningKey,
}

/// What the log's key signs. Its size does not depend on who wrote it.
#[derive(Clone, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
struct StateStatement {
    log_key: NodeId,
    network: Digest,
    build: Digest,
    size: u64,
    root: Digest,
    /// How many bytes follow, and their SHA-256.
    bytes: u64,
    content: Digest,
}

impl SignableStatement for StateStatement {
    const TAG: &'static str = "zk0:kept-state:v2";

    fn signer(&self) -> NodeId {
        self.log_key
    }
}

impl KeptState {
    pub(crate) fn new(
        dir: &Path,
        build: Digest,
        (state, tree): (State, Frontier),
        fold: Vec<u8>,
        key: SigningKey,
    ) -> Self {
        Self {
            path: folder::state(dir),
            build,
            verified: VerifiedHistory::resume(state, tree, 0),
            fold,
            key,
        }
    }

    /// How many entries it covers.
    pub fn size(&self) -> u64 {
        self.verified.size()
    }

    /// Replaces the folder's kept state, durably.
    pub fn write(&self) -> Result<(), SavedError> {
        let failed = |error| SavedError::Io {
            path: self.path.clone(),
            error,
        };
        let root = self.verified.root();
        let root = root.map_err(|error| failed(io::Error::other(error)))?;
        let content = borsh::to_vec(&(self.verified.state(), &self.fold)).map_err(failed)?;
        let statement = StateStatement {
            log_key: NodeId(self.key.verifying_key().to_bytes()),
            network: *self.verified.state().network(),
            build: self.build,
            size: self.verified.size(),
            root,
            bytes: content.len() as u64,
            content: digest(&content),
        };
        let signed = borsh::to_vec(&Signed::new(statement, &self.key)).map_err(failed)?;
        let written = atomic_file::write(&self.path, Durability::OnDisk, |out| {
            out.write_all(FORMAT)?;
            out.write_all(&signed)?;
            out.write_all(&content)
        });
        written.map_err(failed)
    }
}

/// The history that the kept state in `dir` covers, from which `fold` goes on, if `writer`, the key of this process, has signed it.
///
/// # Errors
/// There is no state that counts. If the key has signed it, and the database lacks what it is about, this is the checkpoint of that.
pub fn resumed(
    store: &Store,
    dir: &Path,
    network: Option<&Digest>,
    writer: &NodeId,
    fold: &mut dyn HistoryFold,
) -> Result<VerifiedHistory, Option<Checkpoint>> {
    let path = folder::state(dir);
    if !path.exists() {
        return Err(None);
    }
    let Some(build) = fold.build() else {
        return Err(None);
    };
    match history(&path, store, network, writer, &build, fold) {
        Ok(history) => {
            let size = history.size();
            tracing::info!("the first {size} entries were verified before");
            Ok(history)
        }
        Err((why, lacking)) => {
            tracing::warn!(
                "the whole history is replayed, because the kept state {} does not count: {why}",
                path.display()
            );
            Err(lacking)
        }
    }
}

/// Checks that `store` has what the writer's key has `signed` with the kept state in `dir`.
///
/// # Errors
/// The database was rolled back, or has another history.
pub fn check_signed(store: &Store, dir: &Path, signed: &Checkpoint) -> Result<(), LedgerError> {
    let held = store.known_tree(signed).map(drop);
    held.inspect_err(|_| {
        tracing::error!(
            "the log's key has signed the kept state {}, and the database does not hold the entries that it is about",
            folder::state(dir).display()
        );
    })
}

/// The history that the file covers. Otherwise why it does not count, and its checkpoint if the key has signed that and the database lacks it.
fn history(
    path: &Path,
    store: &Store,
    network: Option<&Digest>,
    writer: &NodeId,
    build: &Digest,
    fold: &mut dyn HistoryFold,
) -> Result<VerifiedHistory, (String, Option<Checkpoint>)> {
    let uncounted = |why: String| (why, None::<Checkpoint>);
    let file = File::open(path).map_err(|error| uncounted(error.to_string()))?;
    let mut file = BufReader::new(file);
    let statement = signed_by(writer, &mut file).map_err(uncounted)?;
    let found = founder(store).map_err(uncounted)?.network_id();
    if statement.network != found || network.is_some_and(|network| *network != found) {
        let why = format!("it is of network {}", statement.network);
        return Err(uncounted(why));
    }
    let (size, root) = (statement.size, statement.root);
    let signed = Checkpoint { size, root };
    let tree = store.known_tree(&signed);
    let tree = tree.map_err(|error| (error.to_string(), Some(signed)))?;
    if statement.build != *build {
        return Err(uncounted("another build of zk0 wrote it".into()));
    }
    let (state, kept) = content(&statement, &mut file).map_err(uncounted)?;
    fold.go_on(&kept, size).map_err(uncounted)?;
    Ok(VerifiedHistory::resume(state, tree, 0))
}

/// What `writer` has signed, at the beginning of the file. Reads no further.
fn signed_by(writer: &NodeId, file: &mut impl Read) -> Result<StateStatement, String> {
    let mut format = [0; FORMAT.len()];
    let read = file.read_exact(&mut format);
    if read.is_err() || format != *FORMAT {
        return Err("no aggregator of this release wrote it".into());
    }
    let signed = Signed::<StateStatement>::deserialize_reader(file);
    let signed = signed.map_err(|error| error.to_string())?;
    let verified = signed.verify().map(drop);
    verified.map_err(|error| error.to_string())?;
    if signed.statement.log_key != *writer {
        return Err("the log's present key has not signed it".into());
    }
    Ok(signed.statement)
}

/// The state that was signed, and what the fold keeps: the rest of the file. Reads no more than was signed.
fn content(statement: &StateStatement, file: &mut impl Read) -> Result<(State, Vec<u8>), String> {
    let bytes = bounded_file::read_from(file, statement.bytes);
    let bytes = bytes.map_err(|error| error.to_string())?;
    if digest(&bytes) != statement.content {
        return Err("the log's key has not signed what is in it".into());
    }
    borsh::from_slice(&bytes).map_err(|error| error.to_string())
}

/// The genesis in the first entry.
fn founder(store: &Store) -> Result<Genesis, String> {
    let Chunk { items, .. } = Chunk::read(store, 0..1, None);
    match items.into_iter().next().map(|item| item.entry.body) {
        Some(Body::Genesis(genesis)) => Ok(genesis),
        _ => Err("the first entry is not a genesis".into()),
    }
}

fn digest(content: &[u8]) -> Digest {
    Digest(Sha256::digest(content).into())
}

/// SHA-256 of the running program; `None` if its file cannot be read.
pub fn this_build() -> Option<Digest> {
    static BUILD: OnceLock<Option<Digest>> = OnceLock::new();
    *BUILD.get_or_init(|| match hashed_program() {
        Ok(digest) => Some(digest),
        Err(error) => {
            tracing::warn!("the program's own file cannot be read, so no state is kept: {error}");
            None
        }
    })
}

fn hashed_program() -> io::Result<Digest> {
    // On Linux, this is the running program even if its file was replaced.
    let mut file = match File::open("/proc/self/exe") {
        Ok(file) => file,
        Err(_) => File::open(std::env::current_exe()?)?,
    };
    let (mut hash, mut buffer) = (Sha256::new(), vec![0; 1 << 20]);
    loop {
        match file.read(&mut buffer)? {
            0 => return Ok(Digest(hash.finalize().into())),
            read => hash.update(&buffer[..read]),
        }
    }
}
