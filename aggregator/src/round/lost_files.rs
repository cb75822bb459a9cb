//! Files of the open round that are lost: an update to which a node has committed, or the proof of what was accepted of it. The round cannot
//! close without them. The aggregator names them to their node, which keeps both until the round has closed, and sends them again.

use crate::round::aggregator::Aggregator;
use crate::round::request_error::RequestError;
use zk0_circuits::{Digest, NodeId};
use zk0_ledger::blobs::Blobs;
use zk0_ledger::store::reader::LedgerReader;
use zk0_protocol::blob::Blob;
use zk0_protocol::entries::entry::Body;
use zk0_protocol::entries::signed::{Submission, UploadRequest};
use zk0_protocol::rules::state::Round;

/// The files that a node has contributed to the open round.
pub struct ContributedFiles {
    round: u64,
    update: Option<Digest>,
    /// The entry that decided on the node's newest submission, perhaps in an earlier round.
    decision: Option<u64>,
    blobs: Blobs,
}

/// The files that `node` has contributed to the round `open`.
pub fn contributed(aggregator: &Aggregator, open: &Round, node: NodeId) -> ContributedFiles {
    let commit = open.commits.get(&node);
    ContributedFiles {
        round: open.number(),
        update: commit.map(|commit| commit.update.blob),
        decision: commit.and_then(|_| aggregator.index.decision(&node)),
        blobs: aggregator.ledger().blobs().clone(),
    }
}

impl ContributedFiles {
    /// Which of them are lost.
    pub fn lost(self, ledger: &LedgerReader) -> Result<Vec<Digest>, RequestError> {
        let decided = self.decision.map(|entry| ledger.entry(entry)).transpose()?;
        let proof = match decided.map(|entry| entry.body) {
            Some(Body::ContributionAccepted(signed)) => Some(signed.statement)
                .filter(|submission| submission.claim.terms.round == self.round)
                .map(|submission| submission.proof),
            _ => None,
        };
        let files = self.update.into_iter().chain(proof);
        Ok(files.filter(|file| !self.blobs.contains(file)).collect())
    }
}

/// A file that its node sends again. Its place is among the blobs of the ledger.
pub struct LostFile {
    file: Digest,
    blobs: Blobs,
}

impl Aggregator {
    /// The update of this upload, if its node has committed to it in the open round, and it is lost.
    pub fn lost_update(&self, upload: &UploadRequest) -> Option<LostFile> {
        let open = self.state().round();
        let open = open.filter(|open| open.number() == upload.round)?;
        let commit = open.commits.get(&upload.node)?;
        self.lost_file(upload.blob).filter(|_| commit.update.blob == upload.blob)
    }

    /// The proof of this submission, on which the open round has decided, if it is lost.
    pub fn lost_proof(&self, submission: &Submission) -> Option<LostFile> {
        let open = self.state().round();
        open.filter(|open| open.number() == submission.claim.terms.round)?;
        self.lost_file(submission.proof)
    }

    fn lost_file(&self, file: Digest) -> Option<LostFile> {
        let blobs = self.ledger.blobs().clone();
        (!blobs.contains(&file)).then_some(LostFile { file, blobs })
    }
}

impl LostFile {
    /// Takes the file from where its node has uploaded it.
    pub fn take(self, uploads: &Blobs) -> Result<(), RequestError> {
        self.blobs.link(uploads, &self.file)?;
        tracing::info!(file = %self.file, "a lost update is back");
        Ok(())
    }

    /// Puts the file back, if these are its bytes.
    pub fn put(self, bytes: &[u8]) -> Result<(), RequestError> {
        let blob = Blob::from(bytes);
        if blob.digest() == self.file {
            self.blobs.put(blob)?;
            tracing::info!(file = %self.file, "a lost proof is back");
        }
        Ok(())
    }
}
