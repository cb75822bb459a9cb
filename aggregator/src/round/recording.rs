//! Recording what nodes and members send. What is recorded already is not recorded again: whoever sends it again gets the same
//! receipt.

use crate::round::aggregator::Aggregator;
use crate::round::request::RequestError;
use borsh::BorshDeserialize;
use zk0_circuits::NodeId;
use zk0_ledger::blobs::BlobWriter;
use zk0_protocol::blob::Blob;
use zk0_protocol::entries::entry::{Body, MAX_ENTRY_BYTES};
use zk0_protocol::entries::proposal::Action;
use zk0_protocol::entries::signed::{
    DatasetRegistration, Signed, Submission, UpdateCommitment, UploadRequest,
};
use zk0_protocol::rules::named_blobs::BlobKind;
use zk0_protocol::tlog::receipt::Receipt;
use zk0_protocol::Refusal;
use zk0_verifier::dataset::check_leaf_list;
use zk0_verifier::decide::{decide, Decision};
use zk0_verifier::{authenticate, WeightFiles};

/// The answer to a submission.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Decided {
    /// Why the contribution does not count; `None` if it counts.
    pub rejected: Option<Refusal>,
    /// The receipt of the entry that records the decision.
    pub receipt: Receipt,
}

impl Aggregator {
    /// Records a proposal, a vote, a dispute or a change of key, as it was signed.
    pub fn record(&mut self, body: &[u8]) -> Result<Receipt, RequestError> {
        let body: Body = decode("entry to record", body)?;
        let said_by_members = matches!(
            body,
            Body::Proposed(_) | Body::Voted(_) | Body::Disputed(_) | Body::KeyRotated { .. }
        );
        if !said_by_members {
            return Err(RequestError::Malformed(
                "the entry to record is neither a proposal nor a vote, a dispute or a change of key".into(),
            ));
        }
        if let Some(index) = self.index.said(&body) {
            return Ok(self.ledger.first_receipt(index)?);
        }
        self.check(body.clone())?;
        self.check_at_hand(&body)?;
        self.append(body)
    }

    /// Refuses a proposal to go back to weights whose blob is lost, because no round could start from them, and a proposal of public
    /// samples that are not at hand or cannot be used, because no round could be closed with them.
    fn check_at_hand(&self, body: &Body) -> Result<(), RequestError> {
        let Body::Proposed(signed) = body else {
            return Ok(());
        };
        let round = match &signed.statement.action {
            Action::ChangeRules(rules) => {
                let checked = self.check_public_samples(rules);
                return checked.map_err(RequestError::PublicSamples);
            }
            Action::RestoreWeights { round } => *round,
            _ => return Ok(()),
        };
        match self.state().results().of(round) {
            Some(result) if !self.ledger.blobs().contains(&result.blob) => {
                Err(RequestError::LostWeights {
                    round,
                    blob: result.blob,
                })
            }
            _ => Ok(()),
        }
    }

    /// Records a dataset commitment, and keeps its list of drawn frames as a blob.
    pub fn register(
        &mut self,
        registration: &[u8],
        leaves: &[u8],
    ) -> Result<Receipt, RequestError> {
        let signed: Signed<DatasetRegistration> = decode("dataset registration", registration)?;
        let registration = signed.verify()?.clone();
        let (node, digest) = (registration.node, registration.leaves);
        let body = Body::DatasetCommitted(signed);
        if let Some(known) = self.state().node(&node).and_then(|known| known.dataset) {
            if self.ledger.entry(known.entry)?.body == body {
                return Ok(self.ledger.first_receipt(known.entry)?);
            }
        }
        self.check(body.clone())?;
        let list = Blob::from(leaves);
        if list.digest() != digest {
            return Err(Refusal::Dataset(format!(
                "the list of drawn frames has SHA-256 {}, the registration says {digest}",
                list.digest()
            ))
            .into());
        }
        check_leaf_list(&registration, leaves)?;
        self.ledger.blobs().put(&list)?;
        tracing::info!(%node, samples = registration.dataset.samples, "dataset registered");
        self.append(body)
    }

    /// Begins an upload. The caller writes the blob, and calls [`BlobWriter::finish`] with the request's digest. The writer is
    /// `None` if the node has uploaded the blob before.
    pub fn begin_upload(
        &self,
        request: &[u8],
    ) -> Result<(UploadRequest, Option<BlobWriter>), RequestError> {
        let signed: Signed<UploadRequest> = decode("upload request", request)?;
        let request = signed.verify()?;
        let state = self.state();
        let limit = BlobKind::Update.max_bytes(state.rules());
        let refusal = if request.network != *state.network() {
            Some(Refusal::WrongNetwork {
                claimed: request.network,
                ours: *state.network(),
            })
        } else if state.node(&request.node).is_none() {
            Some(Refusal::NotEnrolled(request.node))
        } else if state.round().map(|round| round.number()) != Some(request.round) {
            Some(Refusal::WrongRound {
                claimed: request.round,
                open: state.round().map(|round| round.number()),
            })
        } else if request.size > limit {
            Some(Refusal::TooLarge {
                what: "the upload".into(),
                size: request.size,
                limit,
            })
        } else {
            None
        };
        if let Some(refusal) = refusal {
            return Err(refusal.into());
        }
        let waiting = self.staging.of(request.round, &request.node);
        let writer = match waiting.contains(&request.blob) {
            true => None,
            false => Some(
                self.staging
                    .begin(request.round, &request.node, request.size)?,
            ),
        };
        Ok((signed.statement, writer))
    }

    /// Records a commitment to an uploaded update.
    pub fn commit(&mut self, commitment: &[u8]) -> Result<Receipt, RequestError> {
        let signed: Signed<UpdateCommitment> = decode("commitment", commitment)?;
        let UpdateCommitment {
            node,
            round,
            update,
            ..
        } = *signed.verify()?;
        if let Some(index) = self.recorded(
            round,
            &node,
            |body| matches!(body, Body::UpdateCommitted(recorded) if *recorded == signed),
        )? {
            return Ok(self.ledger.first_receipt(index)?);
        }
        let body = Body::UpdateCommitted(signed);
        self.check(body.clone())?;
        let waiting = self.staging.of(round, &node);
        if !waiting.contains(&update.blob) {
            return Err(Refusal::MissingUpdate(update.blob).into());
        }
        let bytes = waiting.get(
            &update.blob,
            BlobKind::Update.max_bytes(self.state().rules()),
        )?;
        self.ledger.blobs().put(&bytes)?;
        tracing::info!(%node, round, update = %update.blob, "update committed");
        self.append(body)
    }

    /// Decides on a submission and records the decision.
    pub fn submit(&mut self, submission: &[u8], proof: Vec<u8>) -> Result<Decided, RequestError> {
        let now = self.now_ms();
        let submission: Signed<Submission> = decode("submission", submission)?;
        let contribution = authenticate(submission, proof, self.state())?;
        let claim = contribution.claim();
        let (node, round) = (claim.terms.node, claim.terms.round);
        if let Some(decided) = self.decided(contribution.submission())? {
            return Ok(decided);
        }
        let commit = self
            .state()
            .round()
            .and_then(|round| round.commits.get(&node));
        let opened = self.state().round().map(|round| round.opened.base.blob);
        let Some((update, base)) = commit.map(|commit| commit.update.blob).zip(opened) else {
            // If something is wrong with the claim itself, the node hears that first.
            self.state().check_claim(claim, now)?;
            return Err(Refusal::NotCommitted(node).into());
        };
        // The digests on the ledger count, because a claim may name other blobs.
        let weights = WeightFiles::read(&update, &base, self.state().rules(), |digest, limit| {
            self.ledger.blobs().get(digest, limit)
        })?;
        let decision = decide(self.state(), &contribution, &weights, now)?;
        self.ledger.blobs().put(contribution.proof())?;
        let body = decision.body(&contribution);
        let submission = contribution.submission();
        let receipt = (self.ledger).append_decision(now, body.clone(), submission)?;
        self.index.observe(receipt.index, &body);
        let rejected = match decision {
            Decision::Accepted(verified) => {
                tracing::info!(%node, round, "contribution accepted");
                self.contributions.push(*verified);
                None
            }
            Decision::Rejected(reason) => {
                tracing::warn!(%node, round, %reason, "contribution rejected");
                Some(reason)
            }
        };
        Ok(Decided { rejected, receipt })
    }

    fn decided(&self, submission: &Signed<Submission>) -> Result<Option<Decided>, RequestError> {
        let claim = &submission.statement.claim;
        let mut rejected = None;
        let index = self.recorded(claim.terms.round, &claim.terms.node, |body| match body {
            Body::ContributionAccepted(recorded) => recorded == submission,
            Body::ContributionRejected {
                submission: recorded,
                reason,
            } => {
                rejected = Some(reason.clone());
                recorded == submission
            }
            _ => false,
        })?;
        Ok(match index {
            Some(index) => Some(Decided {
                receipt: self.ledger.first_receipt(index)?,
                rejected,
            }),
            None => None,
        })
    }

    /// The index of an entry about a node that has committed in the open round.
    fn recorded(
        &self,
        round: u64,
        node: &NodeId,
        mut is_it: impl FnMut(&Body) -> bool,
    ) -> Result<Option<u64>, RequestError> {
        let open = self.state().round().filter(|open| open.number() == round);
        let Some(commit) = open.and_then(|open| open.commits.get(node)) else {
            return Ok(None);
        };
        for index in commit.entry..self.ledger.size() {
            if is_it(&self.ledger.entry(index)?.body) {
                return Ok(Some(index));
            }
        }
        Ok(None)
    }
}

/// Decodes a statement as it was signed: exactly these bytes, and not too many of them.
fn decode<T: BorshDeserialize>(what: &str, bytes: &[u8]) -> Result<T, RequestError> {
    if bytes.len() > MAX_ENTRY_BYTES {
        return Err(RequestError::Malformed(format!(
            "the {what} has {} bytes: at most {MAX_ENTRY_BYTES} are read, as many as an entry has",
            bytes.len()
        )));
    }
    borsh::from_slice(bytes).map_err(|error| {
        RequestError::Malformed(format!("these bytes are not a valid {what}: {error}"))
    })
}
