//! The aggregator's one writer: owns the ledger, opens and closes rounds, records what nodes send.
//!
//! Everything here is synchronous and durable before it returns; [`crate::serve::service`] puts a network in front of it. Nothing
//! but the ledger, its blobs and the waiting uploads is kept on disk, and all memory is computed from them: a killed
//! aggregator goes on where it was.

use crate::round::{
    clock::Clock,
    dispute::verify_again,
    ledger_index::{recall, Recalled},
    request::RequestError,
    staging::Staging,
};
use borsh::BorshDeserialize;
use ed25519_dalek::SigningKey;
use std::{path::Path, sync::Arc};
use zk0_circuits::{claim::dataset::check_leaves, Digest, NodeId};
use zk0_ledger::{
    blobs::{BlobWriter, Blobs},
    log::Ledger,
};
use zk0_protocol::rules::disclosed_blobs::BlobAccess;
use zk0_protocol::{
    entries::{
        entry::{Body, DisputeResolved, Entry, ProposalSettled, ENTRY_VERSION, MAX_ENTRY_BYTES},
        genesis::Genesis,
        member::NodeEnrolled,
        signed::{DatasetRegistration, Signed, Submission, UpdateCommitment, UploadRequest},
    },
    rules::state::{Standing, State},
    tlog::receipt::Receipt,
    Refusal,
};
use zk0_verifier::{
    blob_digest, Evaluation, ProgramKey, UnverifiedContribution, VerifiedContribution,
};
use zk0_verifier::{
    close::close,
    decide::{decide, Decision},
};

/// How the operator runs the network.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Config {
    /// Rounds to run in all; `None` for no end.
    pub rounds: Option<u64>,
    /// Nodes that must have registered a dataset before a round opens.
    pub min_nodes: usize,
}

/// What [`Aggregator::step`] did.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Progress {
    /// Nothing: nodes are awaited.
    Waiting,
    /// Opened this round.
    Opened(u64),
    /// Closed this round.
    Closed(u64),
    /// Settled this proposal.
    Settled(u64),
    /// Decided the dispute of this entry.
    Resolved(u64),
    /// All rounds are done.
    Finished,
}

/// The decision on a submission, as it is answered.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Decided {
    /// Why it does not count; `None` if it counts.
    pub rejected: Option<Refusal>,
    /// That the decision is on the ledger.
    pub receipt: Receipt,
}

/// Owns the ledger.
pub struct Aggregator {
    ledger: Ledger,
    staging: Staging,
    clock: Arc<dyn Clock>,
    config: Config,
    recalled: Recalled,
    /// What was accepted in the open round.
    contributions: Vec<VerifiedContribution>,
}

impl Aggregator {
    /// Founds a network in `dir`: `policy` is the whole initial policy, `initial` the expert weights that round 0 starts
    /// from, both as safetensors files with the digests that the genesis names.
    pub fn found(
        dir: &Path,
        genesis: Genesis,
        key: SigningKey,
        policy: &[u8],
        initial: &[u8],
        clock: Arc<dyn Clock>,
        config: Config,
    ) -> Result<Self, RequestError> {
        check_genesis(&genesis)?;
        let found = blob_digest(policy);
        if found != genesis.policy {
            return Err(RequestError::Malformed(format!(
                "the policy has SHA-256 {found}, the genesis says {}",
                genesis.policy
            )));
        }
        let (size, limit) = (initial.len() as u64, genesis.rules.max_update_bytes);
        if size > limit {
            return Err(RequestError::Malformed(format!(
                "the initial weights have {size} bytes, but the rules allow updates of at most {limit}"
            )));
        }
        Evaluation::of_genesis(&genesis)?.check_update(initial, &genesis.initial)?;
        // Blobs first: there is never a ledger that names weights which are not there.
        let blobs = Blobs::at(dir);
        blobs.put(policy)?;
        blobs.put(initial)?;
        let (ledger, _) = Ledger::create(dir, genesis, key, clock.now_ms())?;
        Self::resume(ledger, clock, config)
    }

    /// Opens the network in `dir` and goes on where it was. If `network` is given, it has to be that one.
    pub fn open(
        dir: &Path,
        network: Option<&Digest>,
        key: SigningKey,
        clock: Arc<dyn Clock>,
        config: Config,
    ) -> Result<Self, RequestError> {
        let ledger = Ledger::open(dir, network, key)?;
        check_genesis(ledger.state().genesis())?;
        Self::resume(ledger, clock, config)
    }

    fn resume(
        mut ledger: Ledger,
        clock: Arc<dyn Clock>,
        config: Config,
    ) -> Result<Self, RequestError> {
        let steady = clock.clone();
        ledger.watch_clock(clock.now_ms(), move || steady.steady())?;
        let (recalled, contributions) = recall(&ledger)?;
        Ok(Self {
            staging: Staging::at(ledger.dir()),
            ledger,
            clock,
            config,
            recalled,
            contributions,
        })
    }

    /// The network as it is now.
    pub fn state(&self) -> &State {
        self.ledger.state()
    }

    /// The ledger.
    pub fn ledger(&self) -> &Ledger {
        &self.ledger
    }

    /// The time that an entry recorded now gets.
    pub fn now_ms(&self) -> u64 {
        self.ledger.time_ms(self.clock.now_ms())
    }

    /// Enrols a node.
    pub fn enrol(&mut self, node: NodeId, name: String) -> Result<Receipt, RequestError> {
        self.append(Body::NodeEnrolled(NodeEnrolled { node, name }))
    }

    /// Opens the next round or closes the open one, if it is time to.
    pub fn step(&mut self) -> Result<Progress, RequestError> {
        let now = self.now_ms();
        let state = self.state();
        if state.round().is_some() {
            return match state.may_close(now) {
                true => self.close().map(Progress::Closed),
                false => Ok(Progress::Waiting),
            };
        }
        if let Some(number) = state.due(now) {
            return self.settle(number, now);
        }
        if let Some((entry, dispute)) = state.undecided() {
            return self.resolve(entry, dispute.contribution);
        }
        if self
            .config
            .rounds
            .is_some_and(|rounds| state.next_round() >= rounds)
        {
            return Ok(Progress::Finished);
        }
        let ready = state
            .nodes()
            .values()
            .filter(|node| node.dataset.is_some() && node.standing == Standing::Active);
        if ready.count() < self.config.min_nodes {
            return Ok(Progress::Waiting);
        }
        let opening = state.next_opening(now)?;
        let round = opening.round;
        self.append_at(now, Body::RoundOpened(opening))?;
        tracing::info!(round, "round opened");
        Ok(Progress::Opened(round))
    }

    fn settle(&mut self, number: u64, now: u64) -> Result<Progress, RequestError> {
        let outcome = self.state().outcome(number, now)?;
        tracing::info!(proposal = number, %outcome, "proposal settled");
        let settled = ProposalSettled {
            proposal: number,
            outcome,
        };
        self.append_at(now, Body::ProposalSettled(settled))?;
        Ok(Progress::Settled(number))
    }

    fn resolve(&mut self, dispute: u64, contribution: u64) -> Result<Progress, RequestError> {
        let upheld = verify_again(&self.ledger, contribution)?;
        match &upheld {
            Some(reason) => tracing::warn!(dispute, %reason, "dispute upheld"),
            None => tracing::info!(dispute, "dispute dismissed: the contribution verifies"),
        }
        self.append(Body::DisputeResolved(DisputeResolved { dispute, upheld }))?;
        Ok(Progress::Resolved(dispute))
    }

    /// Records a proposal, a vote, a dispute or a change of key, as it was signed. Asked again for what is recorded already,
    /// gives a receipt of that.
    pub fn record(&mut self, body: &[u8]) -> Result<Receipt, RequestError> {
        let body: Body = match body.len() {
            size if size > MAX_ENTRY_BYTES => {
                return Err(RequestError::Malformed(format!(
                    "{size} bytes to record: at most {MAX_ENTRY_BYTES} are read"
                )))
            }
            _ => borsh::from_slice(body)
                .map_err(|error| RequestError::Malformed(format!("not to be recorded: {error}")))?,
        };
        let said_by_members = matches!(
            body,
            Body::Proposed(_) | Body::Voted(_) | Body::Disputed(_) | Body::KeyRotated { .. }
        );
        if !said_by_members {
            return Err(RequestError::Malformed(
                "neither a proposal nor a vote, a dispute or a change of key".into(),
            ));
        }
        if let Some(index) = self.recalled.said(&body) {
            return Ok(self.ledger.first_receipt(index)?);
        }
        self.append(body)
    }

    /// That an open proposal was recorded, as far as the first `published` entries go.
    pub fn proposal(&self, number: u64, published: u64) -> Result<Option<Receipt>, RequestError> {
        let index = self.recalled.proposal(number);
        let index = index.filter(|index| *index < published);
        Ok(index
            .map(|index| self.ledger.receipt_at(published, index))
            .transpose()?)
    }

    fn close(&mut self) -> Result<u64, RequestError> {
        let closing = close(self.state(), &self.contributions)?;
        if let Some(file) = &closing.file {
            self.ledger.blobs().put(file)?;
        }
        let (round, contributors) = (closing.closed.round, closing.closed.contributors.len());
        self.append(Body::RoundClosed(closing.closed))?;
        self.contributions.clear();
        self.staging.clear()?;
        tracing::info!(round, contributors, "round closed");
        Ok(round)
    }

    /// Puts a dataset commitment on the ledger; its list of leaves is kept as a blob. Asked again for what is recorded
    /// already, gives the same receipt.
    pub fn register(
        &mut self,
        registration: &[u8],
        leaves: &[u8],
    ) -> Result<Receipt, RequestError> {
        let signed: Signed<DatasetRegistration> = decode("dataset registration", registration)?;
        let DatasetRegistration {
            node,
            dataset,
            leaves: digest,
            ..
        } = *signed.verify()?;
        let body = Body::DatasetCommitted(signed);
        if let Some(known) = self.state().node(&node).and_then(|known| known.dataset) {
            if self.ledger.entry(known.entry)?.body == body {
                return Ok(self.ledger.first_receipt(known.entry)?);
            }
        }
        self.check(body.clone())?;
        let found = blob_digest(leaves);
        if found != digest {
            return Err(Refusal::Dataset(format!(
                "the list of leaves has SHA-256 {found}, the registration says {digest}"
            ))
            .into());
        }
        check_leaves(&dataset, &parse_leaves(leaves)?)
            .map_err(|error| Refusal::Dataset(error.to_string()))?;
        self.ledger.blobs().put(leaves)?;
        tracing::info!(%node, samples = dataset.samples, "dataset registered");
        self.append(body)
    }

    /// Begins an upload; the caller writes, and calls [`BlobWriter::finish`] with the request's digest. `None` if the blob
    /// is there already.
    pub fn begin_upload(
        &self,
        request: &[u8],
    ) -> Result<(UploadRequest, Option<BlobWriter>), RequestError> {
        let signed: Signed<UploadRequest> = decode("upload request", request)?;
        let request = signed.verify()?;
        let state = self.state();
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
        } else if request.size > state.rules().max_update_bytes {
            Some(Refusal::TooLarge {
                what: "the upload".into(),
                size: request.size,
                limit: state.rules().max_update_bytes,
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

    /// Records a commitment to an uploaded update. Asked again for what is recorded already, gives the same receipt: its
    /// checkpoint is the one that fixes the challenge.
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
        let bytes = waiting.get(&update.blob, self.state().rules().max_update_bytes)?;
        self.ledger.blobs().put(&bytes)?;
        tracing::info!(%node, round, update = %update.blob, "update committed");
        self.append(body)
    }

    /// Decides on a submission and records the decision. Asked again for the same submission, gives the same answer.
    pub fn submit(&mut self, submission: &[u8], proof: Vec<u8>) -> Result<Decided, RequestError> {
        let now = self.now_ms();
        let submission: Signed<Submission> = decode("submission", submission)?;
        zk0_verifier::authenticate(&submission, &proof, self.state())?;
        let claim = &submission.statement.claim;
        let (node, round) = (claim.terms.node, claim.terms.round);
        if let Some(decided) = self.decided(&submission)? {
            return Ok(decided);
        }
        let commit = self
            .state()
            .round()
            .and_then(|round| round.commits.get(&node));
        let opened = self.state().round().map(|round| round.opened.base.blob);
        let Some((update, base)) = commit.map(|commit| commit.update.blob).zip(opened) else {
            // Say first what is wrong with the claim itself, if anything is.
            self.state().check_claim(claim, now)?;
            return Err(Refusal::NotCommitted(node).into());
        };
        let limit = self.state().rules().max_update_bytes;
        let contribution = UnverifiedContribution {
            update: self.ledger.blobs().get(&update, limit)?,
            base: self
                .ledger
                .blobs()
                .get(&base, self.state().rules().max_base_bytes())?,
            submission,
            proof,
        };
        let decision = decide(self.state(), &contribution, now)?;
        self.ledger.blobs().put(&contribution.proof)?;
        let receipt = self.append_at(now, decision.body(&contribution))?;
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

    /// Whether and where a blob may be read.
    pub fn blob(&self, digest: &Digest) -> Result<std::path::PathBuf, RequestError> {
        match self.recalled.disclosed.access(digest) {
            BlobAccess::Public => Ok(self.ledger.blobs().path(digest)),
            BlobAccess::HeldBack => Err(RequestError::HeldBack(*digest)),
            BlobAccess::Unknown => Err(RequestError::UnknownBlob(*digest)),
        }
    }

    /// The receipts of a round's opening and, if it is over, closing; of the last round when none is named. All as the first
    /// `published` entries have it.
    pub fn round(
        &self,
        round: Option<u64>,
        published: u64,
    ) -> Result<(Option<Receipt>, Option<Receipt>), RequestError> {
        let Some((opened, closed)) = self.recalled.round(round, published) else {
            return Ok((None, None));
        };
        let receipt = |index| self.ledger.receipt_at(published, index);
        Ok((Some(receipt(opened)?), closed.map(receipt).transpose()?))
    }

    fn check(&self, body: Body) -> Result<(), RequestError> {
        let time_ms = self.now_ms();
        Ok(self.state().check(&Entry {
            version: ENTRY_VERSION,
            time_ms,
            body,
        })?)
    }

    fn append(&mut self, body: Body) -> Result<Receipt, RequestError> {
        self.append_at(self.now_ms(), body)
    }

    fn append_at(&mut self, time_ms: u64, body: Body) -> Result<Receipt, RequestError> {
        let receipt = self.ledger.append(time_ms, body.clone())?;
        self.recalled.observe(receipt.index, &body);
        Ok(receipt)
    }
}

/// A network whose proofs or weights nobody could ever check is not run.
fn check_genesis(genesis: &Genesis) -> Result<(), RequestError> {
    ProgramKey::from_bytes(&genesis.program)
        .map_err(|error| RequestError::Malformed(format!("genesis: {error}")))?;
    Evaluation::of_genesis(genesis)
        .map_err(|error| RequestError::Malformed(format!("genesis: {error}")))?;
    Ok(())
}

/// Decodes a statement as it was signed: exactly these bytes, and not too many of them.
fn decode<T: BorshDeserialize>(what: &str, bytes: &[u8]) -> Result<T, RequestError> {
    if bytes.len() > MAX_ENTRY_BYTES {
        return Err(RequestError::Malformed(format!(
            "a {what} of {} bytes: at most {MAX_ENTRY_BYTES}, as many as an entry has, are read",
            bytes.len()
        )));
    }
    borsh::from_slice(bytes)
        .map_err(|error| RequestError::Malformed(format!("not a signed {what}: {error}")))
}

/// Splits a list of leaf hashes, 32 bytes each.
pub(crate) fn parse_leaves(bytes: &[u8]) -> Result<Vec<Digest>, Refusal> {
    let (leaves, rest) = bytes.as_chunks::<32>();
    match rest {
        [] => Ok(leaves.iter().copied().map(Digest).collect()),
        rest => Err(Refusal::Dataset(format!(
            "its list of leaves ends with {} odd bytes: leaves have 32",
            rest.len()
        ))),
    }
}
