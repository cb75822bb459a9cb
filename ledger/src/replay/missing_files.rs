//! Missing files of contributions that the open round has accepted. The round cannot close without them. Later, only audits need them.

use super::continuing;
use crate::blobs::Blobs;
use crate::error::LedgerError;
use crate::folder;
use crate::store::Store;
use std::fmt;
use std::path::Path;
use zk0_circuits::{Digest, NodeId};
use zk0_protocol::entries::entry::{Body, Entry};
use zk0_protocol::entries::signed::Submission;
use zk0_protocol::rules::named_blobs::BlobKind;

/// A file of an accepted contribution to the open round that is neither in the ledger's folder nor in the store.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MissingFile {
    /// The open round.
    pub round: u64,
    /// Who has contributed it.
    pub node: NodeId,
    /// What it holds: an update or a proof.
    pub kind: BlobKind,
    /// SHA-256 of its bytes.
    pub digest: Digest,
}

impl fmt::Display for MissingFile {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self {
            round,
            node,
            kind,
            digest,
        } = self;
        let what = match kind {
            BlobKind::Proof => "proof",
            _ => "update",
        };
        write!(
            f,
            "the {what} {digest} of node {node}, whose contribution to the open round {round} is accepted"
        )
    }
}

/// The missing files of accepted contributions to the open round of the ledger in `dir`, ordered by node. Blobs are only looked for. The
/// history is replayed only if one is missing.
///
/// # Errors
/// The ledger cannot be read, or its history is not valid.
pub fn missing_files(dir: &Path, blobs: &Blobs) -> Result<Vec<MissingFile>, LedgerError> {
    let database = folder::database(dir);
    if !database.exists() {
        return Err(LedgerError::NoLedger(dir.into()));
    }
    let published = folder::read_checkpoint(dir)?;
    let store = Store::open_read_only(&database)?;
    let mut missing = Vec::new();
    for index in (0..store.size()?).rev() {
        let bytes = store.entry(index)?.ok_or(LedgerError::NoEntry(index))?;
        match Entry::decode(&bytes)?.body {
            Body::RoundOpened(_) | Body::RoundClosed(_) => break,
            Body::ContributionAccepted(submission) => {
                let files = files(&submission.statement).into_iter();
                missing.extend(files.filter(|file| !blobs.contains(&file.digest)));
            }
            _ => {}
        }
    }
    if missing.is_empty() {
        return Ok(missing);
    }
    let history = continuing::verify(&store, dir, None, published.as_deref(), &mut ())?;
    // An accepted contribution need not count for ever.
    let counted = history.state().contributors();
    missing.retain(|file| counted.iter().any(|one| one.node == file.node));
    missing.sort_by_key(|file| file.node);
    Ok(missing)
}

fn files(submission: &Submission) -> [MissingFile; 2] {
    let terms = &submission.claim.terms;
    let file = |kind, digest| MissingFile {
        round: terms.round,
        node: terms.node,
        kind,
        digest,
    };
    [
        file(BlobKind::Update, terms.update.blob),
        file(BlobKind::Proof, submission.proof),
    ]
}
