//! What a ledger's folder publishes at this moment: one checkpoint, and everything up to it that is anyone's to read. Export
//! and the log's server hand out nothing else.
//!
//! Where the folder has a policy, the checkpoint is the newest with its quorum of cosignatures; entries beyond it are on disk
//! and not published. Blobs of an open round are nobody's to read yet ([`crate::disclosed`]).

use crate::disclosed::{Access, Disclosed};
use std::{
    fs::File,
    io::{Cursor, Read},
    path::{Path, PathBuf},
};
use zk0_circuits::Digest;
use zk0_ledger::{
    blobs::Blobs,
    checkpoint::Checkpoint,
    entry::{Body, Entry, Genesis},
    error::LedgerError,
    folder,
    layout::Resource,
    policy::Policy,
    source::{Source, SourceError},
    store::Store,
    tiles,
    verifier_key::VerifierKey,
};

/// A folder's published log at one checkpoint.
pub struct View {
    dir: PathBuf,
    store: Store,
    genesis: Genesis,
    key: VerifierKey,
    policy: Policy,
    text: Vec<u8>,
    checkpoint: Checkpoint,
    disclosed: Disclosed,
}

/// What is handed out.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Content {
    /// These bytes.
    Bytes(Vec<u8>),
    /// The file's bytes.
    File(PathBuf),
}

/// Why a folder publishes nothing.
#[derive(Debug, thiserror::Error)]
pub enum ViewError {
    /// The ledger cannot be read.
    #[error(transparent)]
    Ledger(#[from] LedgerError),
    /// Nothing has its quorum yet.
    #[error("{0} has a policy, but no checkpoint with its quorum yet: nothing is published before the witnesses have cosigned")]
    NotCosigned(PathBuf),
    /// The published checkpoint is not one of this ledger.
    #[error("{path}: {why}")]
    Published { path: PathBuf, why: String },
}

impl View {
    /// The published log in `dir`, as of now; a writer may be at work beside it. `before`, an older view, saves reading again
    /// what was read.
    pub fn open(dir: &Path, before: Option<&Self>) -> Result<Self, ViewError> {
        let path = folder::database(dir);
        if !path.exists() {
            return Err(LedgerError::NoLedger(dir.into()).into());
        }
        // The text first: what it covers was in the database before it was published.
        let policy = folder::read_policy(dir)?;
        let text = published_text(dir, &policy)?;
        let store = Store::open_read_only(&path)?;
        let genesis = match entry(&store, 0)?.body {
            Body::Genesis(genesis) => genesis,
            _ => return Err(LedgerError::NoLedger(dir.into()).into()),
        };
        let file = match policy.wants_witnesses() {
            true => folder::cosigned(dir),
            false => folder::checkpoint(dir),
        };
        let wrong = |why: String| ViewError::Published {
            path: file.clone(),
            why,
        };
        let key = genesis
            .verifier_key()
            .map_err(|error| wrong(error.to_string()))?;
        let checkpoint = policy
            .open(&text, &key)
            .map_err(|error| wrong(error.to_string()))?
            .checkpoint;
        let held = store.size()?;
        if checkpoint.size == 0 || checkpoint.size > held {
            let signed = checkpoint.size;
            return Err(LedgerError::RolledBack { held, signed }.into());
        }
        let found = store.root(checkpoint.size)?;
        if found != checkpoint.root {
            return Err(LedgerError::Forked {
                size: checkpoint.size,
                found,
                signed: checkpoint.root,
            }
            .into());
        }
        let (mut disclosed, from) = match before {
            Some(view) if view.checkpoint.size <= checkpoint.size => {
                (view.disclosed.clone(), view.checkpoint.size)
            }
            _ => (Disclosed::default(), 0),
        };
        for index in from..checkpoint.size {
            disclosed.observe(&entry(&store, index)?.body);
        }
        Ok(Self {
            dir: dir.into(),
            store,
            genesis,
            key,
            policy,
            text,
            checkpoint,
            disclosed,
        })
    }

    /// Whether the folder publishes the same still.
    pub fn is_current(&self) -> Result<bool, ViewError> {
        Ok(published_text(&self.dir, &folder::read_policy(&self.dir)?)? == self.text)
    }

    /// The checkpoint.
    pub fn checkpoint(&self) -> Checkpoint {
        self.checkpoint
    }

    /// The log's key.
    pub fn key(&self) -> &VerifierKey {
        &self.key
    }

    /// The network's id.
    pub fn network(&self) -> Digest {
        self.genesis.network_id()
    }

    /// The root of the first `size` entries.
    pub fn root(&self, size: u64) -> Result<Digest, LedgerError> {
        self.store.root(size)
    }

    /// The blobs that anyone may read, whether or not they are kept.
    pub fn public_blobs(&self) -> impl Iterator<Item = &Digest> {
        self.disclosed.public()
    }

    /// The blobs beside the ledger.
    pub fn blobs(&self) -> Blobs {
        Blobs::at(&self.dir)
    }

    /// What is served under a path; `None` if nothing is.
    pub fn read(&self, resource: &Resource) -> Result<Option<Content>, LedgerError> {
        Ok(match resource {
            Resource::Checkpoint => Some(Content::Bytes(self.text.clone())),
            Resource::Policy => {
                let comment = format!("zk0 network {}", self.network());
                let text = self.policy.for_log(&self.key, &comment);
                Some(Content::Bytes(text.into_bytes()))
            }
            Resource::Tile(tile) => {
                tiles::read(&self.store, self.checkpoint.size, tile)?.map(Content::Bytes)
            }
            Resource::Blob(digest) => {
                let public = self.disclosed.access(digest) == Access::Public;
                let blobs = self.blobs();
                (public && blobs.contains(digest)).then(|| Content::File(blobs.path(digest)))
            }
        })
    }
}

/// A ledger's folder, read like any published log.
impl Source for View {
    fn open(&self, path: &str) -> Result<Option<Box<dyn Read>>, SourceError> {
        let failed = |error: String| SourceError::new(path, error);
        let found = match Resource::parse(path) {
            Some(resource) => self.read(&resource),
            None => Ok(None),
        };
        match found.map_err(|error| failed(error.to_string()))? {
            None => Ok(None),
            Some(Content::Bytes(bytes)) => Ok(Some(Box::new(Cursor::new(bytes)))),
            Some(Content::File(file)) => match File::open(file) {
                Ok(file) => Ok(Some(Box::new(file))),
                Err(error) => Err(failed(error.to_string())),
            },
        }
    }
}

fn published_text(dir: &Path, policy: &Policy) -> Result<Vec<u8>, ViewError> {
    match policy.wants_witnesses() {
        true => folder::read_cosigned(dir)?.ok_or_else(|| ViewError::NotCosigned(dir.into())),
        false => folder::read_checkpoint(dir)?
            .ok_or_else(|| LedgerError::NoCheckpoint(folder::checkpoint(dir)).into()),
    }
}

fn entry(store: &Store, index: u64) -> Result<Entry, LedgerError> {
    let bytes = store.entry(index)?.ok_or(LedgerError::NoEntry(index))?;
    Ok(Entry::decode(&bytes)?)
}
