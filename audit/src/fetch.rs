//! Finds the ledger to audit: a ledger's folder in place, an export or a served log in a mirror.

pub mod behind;
pub mod temporary;

use crate::depth::Depth;
use crate::log_source::{source, Trust, WrongUsage};
use anyhow::{Context, Result};
use std::collections::BTreeSet;
use std::io::Read;
use std::path::{Path, PathBuf};
use temporary::Temporary;
use zk0_circuits::Digest;
use zk0_ledger::error::LedgerError;
use zk0_ledger::folder;
use zk0_ledger::published::mirror::{mirror, MirrorError};
use zk0_ledger::published::reader::PublishedError;
use zk0_ledger::published::source::{LogSource, SourceError};
use zk0_ledger::store::Store;
use zk0_protocol::rules::named_blobs::{named_blobs, BlobKind};
use zk0_protocol::tlog::checkpoint::{Checkpoint, CheckpointError};
use zk0_protocol::tlog::layout::Resource;
use zk0_protocol::tlog::witness_policy::WitnessPolicy;
use zk0_protocol::{Body, Entry, Genesis};

/// Which blobs to fetch.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WantedBlobs {
    /// None.
    Entries,
    /// The proofs, for a light audit.
    Proofs,
    /// All.
    Everything,
}

impl From<Depth> for WantedBlobs {
    fn from(depth: Depth) -> Self {
        match depth {
            Depth::Light => Self::Proofs,
            Depth::Full => Self::Everything,
        }
    }
}

/// A readable ledger's folder.
pub struct Located {
    /// The folder.
    pub dir: PathBuf,
    /// Whether it is the ledger's own folder, whose newest entries may be unpublished.
    pub lies_here: bool,
    /// Fetches what is missing; `None` if nothing was fetched.
    pub fetch_again: Option<Box<dyn Fn() -> Result<()>>>,
    _made: Option<Temporary>,
}

/// Finds `ledger`. Fetches a ledger elsewhere to `keep`, or to a temporary folder.
///
/// # Errors
/// [`WrongUsage`] if `keep` or `trust` does not fit the ledger; otherwise it is unreadable, or [something is wrong](is_fault).
pub fn locate(
    ledger: &str,
    keep: Option<&Path>,
    trust: &Trust,
    wanted: WantedBlobs,
) -> Result<Located> {
    let dir = Path::new(ledger);
    let network = trust.network.as_ref();
    if folder::database(dir).exists() {
        if trust.witness_policy.is_some() {
            return Err(WrongUsage(format!(
                "{ledger} is a ledger's directory, whose checkpoint has only the log's signature: --witness-policy is for an export or \
                 a served log"
            ))
            .into());
        }
        if keep.is_some() {
            return Err(WrongUsage(format!(
                "{ledger} is a ledger's directory: --mirror is for an export or a served log"
            ))
            .into());
        }
        check_network(ledger, dir, network)?;
        let dir = dir.to_owned();
        return Ok(Located {
            dir,
            lies_here: true,
            fetch_again: None,
            _made: None,
        });
    }
    let source = source(ledger, trust.ca.as_deref())?;
    let (dir, made) = match keep {
        Some(dir) => {
            check_network(&dir.to_string_lossy(), dir, network)?;
            (dir.to_owned(), None)
        }
        None => {
            let made = Temporary::make().context("making a temporary directory")?;
            (made.path().to_owned(), Some(made))
        }
    };
    let (ledger, to, trust) = (ledger.to_owned(), dir.clone(), trust.clone());
    let fetch_again = move || {
        let Trust {
            network,
            witness_policy,
            ..
        } = &trust;
        let fetched = fetch(
            source.as_ref(),
            &to,
            witness_policy.as_ref(),
            network.as_ref(),
            wanted,
        );
        fetched.map_err(|error| match error {
            MirrorError::Ledger(LedgerError::OtherNetwork {
                found, expected, ..
            }) => anyhow::Error::from(WrongUsage::other_network(&ledger, &found, &expected)),
            error => anyhow::Error::from(error).context(format!("fetching {ledger}")),
        })
    };
    fetch_again()?;
    Ok(Located {
        dir,
        lies_here: false,
        fetch_again: Some(Box::new(fetch_again)),
        _made: made,
    })
}

/// The network founded by the ledger in `dir`, if its first entry is readable.
pub fn network_of(dir: &Path) -> Option<Digest> {
    genesis_of(dir).map(|genesis| genesis.network_id())
}

fn genesis_of(dir: &Path) -> Option<Genesis> {
    let store = Store::open_read_only(&folder::database(dir)).ok()?;
    let founder = store.entry(0).ok()??;
    match Entry::decode(&founder).ok()?.body {
        Body::Genesis(genesis) => Some(genesis),
        _ => None,
    }
}

/// Whether the log of the ledger in `dir` has signed the checkpoint there.
pub fn is_signed(dir: &Path) -> bool {
    let signed = || {
        let (genesis, text) = (genesis_of(dir)?, folder::read_checkpoint(dir).ok()??);
        Checkpoint::open(&text, genesis.origin(), &genesis.log_key).ok()
    };
    signed().is_some()
}

/// Refuses a ledger in `dir` of another network than the auditor named.
fn check_network(ledger: &str, dir: &Path, expected: Option<&Digest>) -> Result<(), WrongUsage> {
    let Some(expected) = expected else {
        return Ok(());
    };
    match network_of(dir) {
        Some(found) if found != *expected => {
            Err(WrongUsage::other_network(ledger, &found, expected))
        }
        _ => Ok(()),
    }
}

/// Updates the mirror in `dir`, with the wanted blobs.
pub fn fetch(
    source: &dyn LogSource,
    dir: &Path,
    policy: Option<&WitnessPolicy>,
    network: Option<&Digest>,
    wanted: WantedBlobs,
) -> Result<(), MirrorError> {
    let mut selection = Selection {
        source,
        blobs: BTreeSet::new(),
    };
    match wanted {
        WantedBlobs::Everything => {
            mirror(source, dir, policy, network)?;
        }
        WantedBlobs::Entries => {
            mirror(&selection, dir, policy, network)?;
        }
        // The entries name the proofs, and new ones may come meanwhile.
        WantedBlobs::Proofs => {
            mirror(&selection, dir, policy, network)?;
            loop {
                selection.blobs = proofs(dir)?;
                if mirror(&selection, dir, policy, network)?.new_entries == 0 {
                    break;
                }
            }
        }
    }
    Ok(())
}

/// Whether the log served something wrong.
pub fn is_wrong(error: &MirrorError) -> bool {
    match error {
        MirrorError::Published(error) => !matches!(
            error,
            PublishedError::Source(_)
                | PublishedError::Missing(..)
                | PublishedError::NoCheckpoint
                | PublishedError::Behind { .. }
                // Something else answers here, such as a page for browsers.
                | PublishedError::Checkpoint(CheckpointError::NoNote(_))
        ),
        MirrorError::Ledger(error) => matches!(
            error,
            LedgerError::RolledBack { .. }
                | LedgerError::Forked { .. }
                | LedgerError::OtherNetwork { .. }
                | LedgerError::BadEntry { .. }
                | LedgerError::BadPruning { .. }
                | LedgerError::Rule(_)
                | LedgerError::CheckpointFile { .. }
        ),
        MirrorError::BeingUpdated { .. } => false,
        MirrorError::Checkpoint { .. }
        | MirrorError::FormerKey { .. }
        | MirrorError::Witnesses(_)
        | MirrorError::WrongBlob { .. } => true,
    }
}

/// Whether `error` states that something is wrong with the log, and not just unreadable.
pub fn is_fault(error: &anyhow::Error) -> bool {
    let mut causes = error.chain();
    causes.any(|cause| cause.downcast_ref::<MirrorError>().is_some_and(is_wrong))
}

fn proofs(dir: &Path) -> Result<BTreeSet<Digest>, MirrorError> {
    let store = Store::open_read_only(&folder::database(dir))?;
    let mut proofs = BTreeSet::new();
    for index in 0..store.size()? {
        if let Some(bytes) = store.entry(index)? {
            let named = named_blobs(&Entry::decode(&bytes)?.body);
            let named = named.iter().filter(|blob| blob.kind == BlobKind::Proof);
            proofs.extend(named.map(|blob| blob.digest));
        }
    }
    Ok(proofs)
}

struct Selection<'a> {
    source: &'a dyn LogSource,
    blobs: BTreeSet<Digest>,
}

impl LogSource for Selection<'_> {
    fn open(&self, path: &str) -> Result<Option<Box<dyn Read>>, SourceError> {
        match Resource::parse(path) {
            Some(Resource::Blob(digest)) if !self.blobs.contains(&digest) => Ok(None),
            _ => self.source.open(path),
        }
    }
}
