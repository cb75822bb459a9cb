//! What a writer has verified, on disk: its next start replays only newer entries.
//!
//! The file `state` in the ledger's folder has the format of an audit's state ([`super::saved`]). It is as trustworthy as the folder itself:
//! the log's key signs its content, as it signs each checkpoint, and it counts only where the database has its tree. So somebody who can
//! write the folder, and has no key, can put no other state there. It counts only for the build that wrote it, because another may have
//! other rules. If it does not count, the log states why, and the whole history is replayed. An audit reads all entries again.

use super::chunk::Chunk;
use super::saved::{SavedError, SavedReplay, Saving};
use super::verified::{HistoryFold, VerifiedHistory};
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

/// The history that the kept state in `dir` covers, from which `fold` goes on. `None` if there is none that counts.
pub fn resumed(
    store: &Store,
    dir: &Path,
    network: Option<&Digest>,
    fold: &mut dyn HistoryFold,
) -> Option<VerifiedHistory> {
    let path = folder::state(dir);
    if !path.exists() {
        return None;
    }
    let build = fold.build()?;
    match read(&path, store, network, &build, fold) {
        Ok(history) => {
            let size = history.size();
            tracing::info!("the first {size} entries were verified before");
            Some(history)
        }
        Err(why) => {
            tracing::warn!(
                "the whole history is replayed, because the kept state {} does not count: {why}",
                path.display()
            );
            None
        }
    }
}

fn read(
    path: &Path,
    store: &Store,
    network: Option<&Digest>,
    build: &Digest,
    fold: &mut dyn HistoryFold,
) -> Result<VerifiedHistory, String> {
    let saved = SavedReplay::read(path).map_err(|error| error.to_string())?;
    let saved = saved.ok_or("it was just deleted")?;
    let kept = borsh::from_slice::<(Signed<StateStatement>, Vec<u8>)>(&saved.recheck);
    let (signed, kept) = kept.map_err(|_| "no aggregator of this release wrote it")?;
    let genesis = founder(store)?;
    let found = genesis.network_id();
    if *saved.network() != found || network.is_some_and(|network| *network != found) {
        return Err(format!("it is of network {}", saved.network()));
    }
    let verified = signed.verify().map(drop);
    verified.map_err(|error| error.to_string())?;
    let statement = signed.statement;
    if statement.build != *build {
        return Err("another build of zk0 wrote it".into());
    }
    let (size, root) = (saved.size, saved.root);
    let content = StateStatement {
        log_key: NodeId(*saved.state.log_keys().present()),
        build: statement.build,
        size,
        root,
        state: saved.state.digest(),
        fold: fold_digest(&kept),
    };
    if statement != content {
        return Err("the log's key has not signed what is in it".into());
    }
    let tree = store.known_tree(&Checkpoint { size, root });
    let tree = tree.map_err(|error| error.to_string())?;
    fold.go_on(&kept, size)?;
    Ok(VerifiedHistory::resume(
        saved.state,
        tree,
        saved.checkpoints,
    ))
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
