//! What a ledger's folder publishes at this moment: one checkpoint, and everything up to it that is anyone's to read. Export
//! and the log's server hand out nothing else.
//!
//! Where the network's rules ask for witnesses, or else the folder has a policy, the checkpoint is the newest with its quorum of
//! cosignatures; entries beyond it are on disk and not published. Blobs of an open round are nobody's to read yet ([`zk0_protocol::rules::disclosed_blobs`]).

use crate::{
    blobs::Blobs,
    error::LedgerError,
    folder,
    published::{
        source::{Source, SourceError},
        tiles,
    },
    store::Store,
};
use std::{
    fs::File,
    io::{Cursor, Read},
    path::{Path, PathBuf},
};
use zk0_circuits::Digest;
use zk0_protocol::rules::disclosed_blobs::{BlobAccess, DisclosedBlobs};
use zk0_protocol::{
    entries::{
        entry::{Body, Entry},
        genesis::Genesis,
    },
    rules::required_witnesses::RequiredWitnesses,
    tlog::{
        checkpoint::{Checkpoint, Parsed},
        layout::Resource,
        verifier_key::VerifierKey,
        witness_policy::WitnessPolicy,
    },
};

/// A folder's published log at one checkpoint.
pub struct Publication {
    dir: PathBuf,
    store: Store,
    genesis: Genesis,
    key: VerifierKey,
    policy: WitnessPolicy,
    /// The folder's own policy, which counts where the rules ask for no witnesses.
    own_policy: WitnessPolicy,
    text: Vec<u8>,
    checkpoint: Checkpoint,
    /// Of the entries up to the checkpoint.
    told: Told,
}

/// What may be published. It is read before the database: what it covers is in there then.
struct Texts {
    checkpoint: Option<Vec<u8>>,
    cosigned: Option<Vec<u8>>,
}

/// What a log's first entries say, as a fold over them.
#[derive(Clone, Default)]
struct Told {
    size: u64,
    disclosed: DisclosedBlobs,
    asked: RequiredWitnesses,
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
pub enum PublicationError {
    /// The ledger cannot be read.
    #[error(transparent)]
    Ledger(#[from] LedgerError),
    /// Nothing has its quorum yet.
    #[error("{0} has no checkpoint with a quorum of cosignatures yet: nothing is published before the witnesses have cosigned")]
    NotCosigned(PathBuf),
    /// The published checkpoint is not one of this ledger.
    #[error("{path}: {why}")]
    Published { path: PathBuf, why: String },
}

impl Publication {
    /// The published log in `dir`, as of now; a writer may be at work beside it. `before`, an older view, saves reading again
    /// what was read.
    pub fn open(dir: &Path, before: Option<&Self>) -> Result<Self, PublicationError> {
        let path = folder::database(dir);
        if !path.exists() {
            return Err(LedgerError::NoLedger(dir.into()).into());
        }
        let (own_policy, texts) = (folder::read_policy(dir)?, Texts::read(dir)?);
        let store = Store::open_read_only(&path)?;
        let genesis = match entry(&store, 0)?.body {
            Body::Genesis(genesis) => genesis,
            _ => return Err(LedgerError::NoLedger(dir.into()).into()),
        };
        let held = store.size()?;
        // What a checkpoint needs, the rules that it covers say.
        let told_by =
            |file: &Path, text: &[u8]| -> Result<(Told, WitnessPolicy), PublicationError> {
                let signed = Parsed::read(text).map_err(not_published(file))?;
                let size = signed.checkpoint.size.min(held);
                let known = before.map(|view| &view.told);
                let known = known.filter(|told| told.size <= size).cloned();
                let told = known.unwrap_or_default().up_to(&store, size)?;
                let ruled = told.asked.policy().map_err(not_published(file))?;
                Ok((told, ruled))
            };
        let file = folder::checkpoint(dir);
        let text = texts.checkpoint;
        let text = text.ok_or_else(|| LedgerError::NoCheckpoint(file.clone()))?;
        let (told, ruled) = told_by(&file, &text)?;
        let uncosigned = !ruled.wants_witnesses() && !own_policy.wants_witnesses();
        let (file, text, told, policy) = match uncosigned {
            true => (file, text, told, WitnessPolicy::none()),
            false => {
                let file = folder::cosigned(dir);
                let text = texts.cosigned;
                let text = text.ok_or_else(|| PublicationError::NotCosigned(dir.into()))?;
                let (told, ruled_then) = told_by(&file, &text)?;
                let policies = [ruled_then, own_policy.clone(), ruled];
                let policy = policies.into_iter().find(WitnessPolicy::wants_witnesses);
                (file, text, told, policy.unwrap_or(WitnessPolicy::none()))
            }
        };
        let key = genesis.verifier_key().map_err(not_published(&file))?;
        let opened = policy.open(&text, &key).map_err(not_published(&file))?;
        let checkpoint = opened.checkpoint;
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
        Ok(Self {
            dir: dir.into(),
            store,
            genesis,
            key,
            policy,
            own_policy,
            text,
            checkpoint,
            told,
        })
    }

    /// Whether the folder publishes the same still.
    pub fn is_current(&self) -> Result<bool, PublicationError> {
        let texts = Texts::read(&self.dir)?;
        let text = match self.policy.wants_witnesses() {
            true => texts.cosigned,
            false => texts.checkpoint,
        };
        let policy = folder::read_policy(&self.dir)?;
        Ok(text.as_ref() == Some(&self.text) && policy.text() == self.own_policy.text())
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
        self.told.disclosed.public()
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
                let public = self.told.disclosed.access(digest) == BlobAccess::Public;
                let blobs = self.blobs();
                (public && blobs.contains(digest)).then(|| Content::File(blobs.path(digest)))
            }
        })
    }
}

/// A ledger's folder, read like any published log.
impl Source for Publication {
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

impl Texts {
    fn read(dir: &Path) -> Result<Self, LedgerError> {
        Ok(Self {
            checkpoint: folder::read_checkpoint(dir)?,
            cosigned: folder::read_cosigned(dir)?,
        })
    }
}

impl Told {
    /// As far as the first `size` entries go, which are no fewer than before.
    fn up_to(mut self, store: &Store, size: u64) -> Result<Self, LedgerError> {
        for index in self.size..size {
            let body = entry(store, index)?.body;
            self.disclosed.observe(&body);
            self.asked.observe(&body);
        }
        self.size = size;
        Ok(self)
    }
}

/// That what `file` holds is not published, and why.
fn not_published<E: ToString>(file: &Path) -> impl Fn(E) -> PublicationError + '_ {
    |error| PublicationError::Published {
        path: file.into(),
        why: error.to_string(),
    }
}

fn entry(store: &Store, index: u64) -> Result<Entry, LedgerError> {
    let bytes = store.entry(index)?.ok_or(LedgerError::NoEntry(index))?;
    Ok(Entry::decode(&bytes)?)
}
