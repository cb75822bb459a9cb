//! What a writer has verified, on disk: its next start replays only newer entries.
//!
//! The file `state` in the ledger's folder has the format of an audit's state ([`super::saved`]). It is as trustworthy as the folder itself:
//! the log's key signs its content, as it signs each checkpoint, and it counts only for the writer with that key, where the database has its
//! tree. So somebody who can write the folder, and has no key or a former one, can put no other state there. It counts only for the build
//! that wrote it, because another may have other rules. If it does not count, the log states why, and the whole history is replayed. An audit
//! reads all entries again.

use super::chunk::Chunk;
use super::saved::{SavedError, SavedReplay, Saving};
use super::verified::{HistoryFold, VerifiedHistory};
use crate::error::LedgerError;
use crate::folder;
use crate::store::Store;
use borsh::{BorshDeserialize, BorshSerialize};
use ed25519_dalek::SigningKey;
use sha2::{Digest as _, Sha256};
use std::fs::File;
use std::io::{self, Read};
use std::path::{Path, PathBuf};
use std::sync::OnceLock;
use zk0_circuits::vm::digest::tagged_sha256;
use zk0_circuits::{Digest, NodeId};
use zk0_protocol::entries::signed::{SignableStatement, Signed};
use zk0_protocol::rules::state::State;
use zk0_protocol::tlog::checkpoint::Checkpoint;
use zk0_protocol::tlog::tree::Frontier;
use zk0_protocol::{Body, Genesis};

/// A writer's verified state, for its next start.
pub struct KeptState {
    path: PathBuf,
    build: Digest,
    verified: VerifiedHistory,
    fold: Vec<u8>,
    key: SigningKey,
}

/// What the log's key signs. The digests are those of the program, of the tree, of [`State::digest`], and of what the fold keeps.
#[derive(Clone, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
struct StateStatement {
    log_key: NodeId,
    build: Digest,
    size: u64,
    root: Digest,
    state: Digest,
    fold: Digest,
}

impl SignableStatement for StateStatement {
    const TAG: &'static str = "zk0:kept-state:v1";

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
        let statement = StateStatement {
            log_key: NodeId(self.key.verifying_key().to_bytes()),
            build: self.build,
            size: self.verified.size(),
            root,
            state: self.verified.state().digest(),
            fold: fold_digest(&self.fold),
        };
        let signed = Signed::new(statement, &self.key);
        let recheck = borsh::to_vec(&(signed, &self.fold)).map_err(failed)?;
        let saving = Saving {
            verified: &self.verified,
            findings: &Vec::new(),
            recheck,
        };
        saving.write(&self.path)
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
    let signed = SignedState::read(&path, store, network, writer).map_err(|why| (why, None));
    match signed.and_then(|signed| signed.history(store, &build, fold)) {
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

/// A kept state of the store's network, as the writer's key has signed it.
struct SignedState {
    saved: SavedReplay,
    build: Digest,
    fold: Vec<u8>,
}

impl SignedState {
    fn read(
        path: &Path,
        store: &Store,
        network: Option<&Digest>,
        writer: &NodeId,
    ) -> Result<Self, String> {
        let saved = SavedReplay::read(path).map_err(|error| error.to_string())?;
        let saved = saved.ok_or("it was just deleted")?;
        let kept = borsh::from_slice::<(Signed<StateStatement>, Vec<u8>)>(&saved.recheck);
        let (signed, fold) = kept.map_err(|_| "no aggregator of this release wrote it")?;
        let found = founder(store)?.network_id();
        if *saved.network() != found || network.is_some_and(|network| *network != found) {
            return Err(format!("it is of network {}", saved.network()));
        }
        let verified = signed.verify().map(drop);
        verified.map_err(|error| error.to_string())?;
        let statement = signed.statement;
        let content = StateStatement {
            log_key: *writer,
            build: statement.build,
            size: saved.size,
            root: saved.root,
            state: saved.state.digest(),
            fold: fold_digest(&fold),
        };
        if statement != content {
            return Err("the log's present key has not signed what is in it".into());
        }
        Ok(Self {
            saved,
            build: statement.build,
            fold,
        })
    }

    /// The history that it covers. Otherwise why it does not count, and its checkpoint if the database lacks that.
    fn history(
        self,
        store: &Store,
        build: &Digest,
        fold: &mut dyn HistoryFold,
    ) -> Result<VerifiedHistory, (String, Option<Checkpoint>)> {
        let (size, root) = (self.saved.size, self.saved.root);
        let tree = store.known_tree(&Checkpoint { size, root });
        let lacking = Some(Checkpoint { size, root });
        let tree = tree.map_err(|error| (error.to_string(), lacking))?;
        if self.build != *build {
            return Err(("another build of zk0 wrote it".into(), None));
        }
        let went_on = fold.go_on(&self.fold, size);
        went_on.map_err(|why| (why, None))?;
        let SavedReplay {
            state, checkpoints, ..
        } = self.saved;
        Ok(VerifiedHistory::resume(state, tree, checkpoints))
    }
}

/// The genesis in the first entry.
fn founder(store: &Store) -> Result<Genesis, String> {
    let Chunk { items, .. } = Chunk::read(store, 0..1, None);
    match items.into_iter().next().map(|item| item.entry.body) {
        Some(Body::Genesis(genesis)) => Ok(genesis),
        _ => Err("the first entry is not a genesis".into()),
    }
}

fn fold_digest(fold: &[u8]) -> Digest {
    tagged_sha256("zk0/kept-fold/v1", &[fold])
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
