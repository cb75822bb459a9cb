//! Lost files of the open round: a committed update, or an accepted proof. The round cannot close without them. The aggregator asks their
//! node, which keeps both until the round has closed. After the time in the rules, the round closes without the contribution.

use crate::round::aggregator::Aggregator;
use crate::round::request_error::RequestError;
use zk0_circuits::{Digest, NodeId};
use zk0_ledger::blobs::Blobs;
use zk0_protocol::blob::Blob;
use zk0_protocol::entries::entry::{Body, LostContribution};
use zk0_protocol::entries::signed::{Submission, UploadRequest};
use zk0_protocol::rules::state::Round;

/// The files that a node has contributed to the open round.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ContributedFiles {
    node: NodeId,
    /// SHA-256 of each.
    pub files: Vec<Digest>,
}

impl ContributedFiles {
    /// The lost ones among them, if any.
    pub fn lost(mut self, blobs: &Blobs) -> Option<Self> {
        self.files.retain(|file| !blobs.contains(file));
        (!self.files.is_empty()).then_some(self)
    }
}

/// A file that its node sends again, and the ledger's blobs.
pub struct LostFile {
    file: Digest,
    blobs: Blobs,
}

impl LostFile {
    /// Takes the file from its node's uploads.
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

impl Aggregator {
    /// The files that `node` has contributed to the round `open`.
    pub fn contributed(&self, open: &Round, node: NodeId) -> ContributedFiles {
        let update = open.commits.get(&node).map(|commit| commit.update.blob);
        let proof = self.index.proofs.get(&node).copied();
        ContributedFiles {
            node,
            files: update.into_iter().chain(proof).collect(),
        }
    }

    pub(in crate::round) fn all_contributed(&self) -> Vec<ContributedFiles> {
        let Some(open) = self.state().round() else {
            return Vec::new();
        };
        let contributors = self.state().contributors().into_iter();
        let files = contributors.map(|one| self.contributed(open, one.node));
        files.collect()
    }

    /// This upload's update, if it is committed in the open round, and lost.
    pub fn lost_update(&self, upload: &UploadRequest) -> Option<LostFile> {
        let open = self.state().round();
        let open = open.filter(|open| open.number() == upload.round)?;
        let commit = open.commits.get(&upload.node)?;
        let update = commit.update.blob;
        (update == upload.blob).then(|| self.lost_file(update))?
    }

    /// This submission's proof, if it is accepted in the open round, and lost.
    pub fn lost_proof(&self, submission: &Submission) -> Option<LostFile> {
        let proof = *self.index.proofs.get(&submission.claim.terms.node)?;
        (proof == submission.proof).then(|| self.lost_file(proof))?
    }

    fn lost_file(&self, file: Digest) -> Option<LostFile> {
        let blobs = self.ledger.blobs().clone();
        (!blobs.contains(&file)).then_some(LostFile { file, blobs })
    }

    /// Records that these files are lost, and leaves out the contributions whose time in the rules is over. Returns why the round cannot
    /// close yet.
    pub(in crate::round) fn lose(
        &mut self,
        all: &[ContributedFiles],
    ) -> Result<Option<String>, RequestError> {
        let accepted: Vec<_> = self.state().contributors();
        let is_accepted = |of: &&ContributedFiles| accepted.iter().any(|one| one.node == of.node);
        let mut waits = false;
        for ContributedFiles { node, .. } in all.iter().filter(is_accepted) {
            let (node, now) = (*node, self.now_ms());
            let Some(open) = self.state().round() else {
                return Ok(None);
            };
            let (round, is_asked) = (open.number(), open.lost.contains_key(&node));
            let lost = LostContribution { round, node };
            if self.state().may_leave_out(&lost, now) {
                tracing::error!(%node, round, "an accepted contribution is left out, because a file of it is lost and has not come back");
                self.append_at(now, Body::ContributionLeftOut(lost))?;
                self.contributions.retain(|one| one.node() != node);
                self.lost.retain(|one| one.node() != node);
                continue;
            }
            waits = true;
            if !is_asked {
                self.append_at(now, Body::FilesLost(lost))?;
            }
        }
        let files = all.iter().flat_map(|of| {
            let file = move |file: &Digest| format!("{file} of node {}", of.node);
            of.files.iter().map(file)
        });
        Ok(waits.then(|| {
            format!(
                "the open round cannot close, because files of accepted contributions are lost: {}; their nodes are asked for them, and after {} minutes the round closes without these contributions, unless you put the files back among the blobs in {}",
                files.collect::<Vec<_>>().join(", "),
                self.state().rules().submit_window_ms.div_ceil(60_000),
                self.ledger.dir().display()
            )
        }))
    }
}
