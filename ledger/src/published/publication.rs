//! What a ledger's folder publishes now: one checkpoint, and all that is public up to it. The export and the log's server serve nothing
//! else.
//!
//! If the rules or the folder's policy require witnesses, the published checkpoint is the newest one with its quorum of cosignatures. Later
//! entries, and blobs of an open round, are not public yet ([`zk0_protocol::rules::disclosed_blobs`]).

use crate::blobs::{BlobError, Blobs};
use crate::error::LedgerError;
use crate::folder;
use crate::pruned;
use crate::published::source::{LogSource, SourceError};
use crate::published::tiles;
use crate::store::Store;
use std::fs::File;
use std::io::{Cursor, Read};
use std::path::{Path, PathBuf};
use zk0_circuits::Digest;
use zk0_protocol::entries::entry::{Body, Entry};
use zk0_protocol::entries::genesis::Genesis;
use zk0_protocol::rules::disclosed_blobs::{BlobAccess, DisclosedBlobs};
use zk0_protocol::rules::required_witnesses::RequiredWitnesses;
use zk0_protocol::tlog::checkpoint::{Checkpoint, Parsed};
use zk0_protocol::tlog::layout::Resource;
use zk0_protocol::tlog::verifier_key::VerifierKey;
use zk0_protocol::tlog::witness_policy::WitnessPolicy;

/// A folder's published log at one checkpoint.
pub struct Publication {
    dir: PathBuf,
    blobs: Blobs,
    store: Store,
    genesis: Genesis,
    key: VerifierKey,
    policy: WitnessPolicy,
    /// The folder's own policy, used if the rules require no witnesses.
    own_policy: WitnessPolicy,
    text: Vec<u8>,
    checkpoint: Checkpoint,
    gathered: GatheredEntries,
}

/// The checkpoints that may be published. They are read before the database, which then holds their entries.
struct Texts {
    checkpoint: Option<Vec<u8>>,
    cosigned: Option<Vec<u8>>,
}

#[derive(Clone, Default)]
struct GatheredEntries {
    size: u64,
    disclosed: DisclosedBlobs,
    /// The blobs that became public since the view before; `None` without one.
    fresh: Option<Vec<Digest>>,
    required: RequiredWitnesses,
}

/// What is handed out.
#[derive(Debug)]
pub enum Content {
    /// These bytes.
    Bytes(Vec<u8>),
    /// The bytes of this file.
    File(File),
}

/// Why a folder publishes nothing.
#[derive(Debug, thiserror::Error)]
pub enum PublicationError {
    /// The ledger cannot be read.
    #[error(transparent)]
    Ledger(#[from] LedgerError),
    /// No checkpoint has its quorum yet.
    #[error("{0} has no checkpoint with a quorum of cosignatures yet. Nothing is published before the witnesses have cosigned")]
    NotCosigned(PathBuf),
    /// The published checkpoint is not one of this ledger.
    #[error("{path}: {why}")]
    Published { path: PathBuf, why: String },
}

impl Publication {
    /// What `dir` publishes now, perhaps beside a writer. Does not read entries of the older view `before` again.
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
        // The entries up to a checkpoint have the rules for its cosignatures.
        let gathered_from = |file: &Path,
                             text: &[u8]|
         -> Result<(GatheredEntries, WitnessPolicy), PublicationError> {
            let signed = Parsed::read(text).map_err(not_published(file))?;
            let size = signed.checkpoint.size.min(held);
            let known = before.map(|view| &view.gathered);
            let known = known.filter(|gathered| gathered.size <= size).cloned();
            let gathered = known.unwrap_or_default().up_to(&store, size)?;
            let ruled = gathered.required.policy().map_err(not_published(file))?;
            Ok((gathered, ruled))
        };
        let file = folder::checkpoint(dir);
        let text = texts.checkpoint;
        let text = text.ok_or_else(|| LedgerError::NoCheckpoint(file.clone()))?;
        let (gathered, ruled) = gathered_from(&file, &text)?;
        let uncosigned = !ruled.wants_witnesses() && !own_policy.wants_witnesses();
        let (file, text, gathered, policy) = if uncosigned {
            (file, text, gathered, WitnessPolicy::none())
        } else {
            let file = folder::cosigned(dir);
            let text = texts.cosigned;
            let text = text.ok_or_else(|| PublicationError::NotCosigned(dir.into()))?;
            let (gathered, ruled_then) = gathered_from(&file, &text)?;
            let policies = [ruled_then, own_policy.clone(), ruled];
            let policy = policies.into_iter().find(WitnessPolicy::wants_witnesses);
            (
                file,
                text,
                gathered,
                policy.unwrap_or(WitnessPolicy::none()),
            )
        };
        let key = genesis.verifier_key().map_err(not_published(&file))?;
        let opened = policy.open(&text, &key).map_err(not_published(&file))?;
        let checkpoint = opened.checkpoint;
        store.known_tree(&checkpoint)?;
        Ok(Self {
            dir: dir.into(),
            blobs: before.map_or_else(|| Blobs::at(dir), Self::blobs),
            store,
            genesis,
            key,
            policy,
            own_policy,
            text,
            checkpoint,
            gathered,
        })
    }

    /// The same log, with blobs perhaps kept in a store.
    pub fn with_blobs(self, blobs: Blobs) -> Self {
        Self { blobs, ..self }
    }

    /// Whether the folder still publishes the same.
    pub fn is_current(&self) -> Result<bool, PublicationError> {
        let texts = Texts::read(&self.dir)?;
        let text = if self.policy.wants_witnesses() {
            texts.cosigned
        } else {
            texts.checkpoint
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

    /// The public blobs, kept or not.
    pub fn public_blobs(&self) -> impl Iterator<Item = &Digest> {
        self.gathered.disclosed.public()
    }

    /// The blobs that became public since the older view with which this one was opened; all without one.
    pub fn new_blobs(&self) -> Box<dyn Iterator<Item = &Digest> + '_> {
        match &self.gathered.fresh {
            Some(fresh) => Box::new(fresh.iter()),
            None => Box::new(self.public_blobs()),
        }
    }

    /// A public blob's size in bytes; `None` if it is not public, or not kept. Does not read the store.
    pub fn blob_size(&self, blob: &Digest) -> Option<u64> {
        self.is_public(blob).then(|| self.blobs.size(blob))?
    }

    /// Whether a blob is public, kept or not.
    pub fn is_public(&self, blob: &Digest) -> bool {
        self.gathered.disclosed.access(blob) == BlobAccess::Public
    }

    /// The blobs beside the ledger.
    pub fn blobs(&self) -> Blobs {
        self.blobs.clone()
    }

    /// A resource's content, if served. A blob outside the folder is first read from the store.
    pub fn read(&self, resource: &Resource) -> Result<Option<Content>, LedgerError> {
        Ok(match resource {
            Resource::Checkpoint => Some(Content::Bytes(self.text.clone())),
            Resource::Policy => {
                let comment = format!("zk0 network {}", self.network());
                let text = self.policy.for_log(&self.key, &comment);
                Some(Content::Bytes(text.into_bytes()))
            }
            Resource::Pruned => pruned::read_signed(&self.dir, &self.genesis)?
                .map(|signed| Content::Bytes(signed.into_bytes())),
            Resource::Tile(tile) => {
                tiles::read(&self.store, self.checkpoint.size, tile)?.map(Content::Bytes)
            }
            Resource::Blob(digest) => {
                if !self.is_public(digest) {
                    return Ok(None);
                }
                match self.blobs.file(digest) {
                    Err(BlobError::Missing(_)) => None,
                    file => Some(Content::File(file?)),
                }
            }
        })
    }
}

impl LogSource for Publication {
    fn open(&self, path: &str) -> Result<Option<Box<dyn Read>>, SourceError> {
        let failed = |error: String| SourceError::new(path, error);
        let found = match Resource::parse(path) {
            Some(resource) => self.read(&resource),
            None => Ok(None),
        };
        match found.map_err(|error| failed(error.to_string()))? {
            None => Ok(None),
            Some(Content::Bytes(bytes)) => Ok(Some(Box::new(Cursor::new(bytes)))),
            Some(Content::File(file)) => Ok(Some(Box::new(file))),
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

impl GatheredEntries {
    /// Goes on to the first `size` entries.
    fn up_to(mut self, store: &Store, size: u64) -> Result<Self, LedgerError> {
        self.fresh = (self.size > 0).then(Vec::new);
        for index in self.size..size {
            let body = entry(store, index)?.body;
            let disclosed = self.disclosed.observe(&body);
            if let Some(fresh) = &mut self.fresh {
                fresh.extend(disclosed);
            }
            self.required.observe(&body);
        }
        self.size = size;
        Ok(self)
    }
}

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
