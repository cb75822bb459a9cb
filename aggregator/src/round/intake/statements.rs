//! Records what nodes, members and the operator sign, in three steps. The first compares a statement with the ledger's state. The second
//! uses files, and needs no aggregator, so that the rounds go on. The third compares again and records ([`crate::round::intake::group`]).
//! [`SentStatement::read`] has verified signatures before.
//!
//! A repeated statement gets a receipt of the same entry. [`crate::round::intake::submission`] has the same steps.

use crate::round::aggregator::Aggregator;
use crate::round::intake::admission::Comparison;
use crate::round::intake::registrations::{MAX_REGISTRATIONS, PERIOD_MS};
use crate::round::intake::staging::Staging;
use crate::round::public_samples::check_public_samples;
use crate::round::request_error::RequestError;
use borsh::BorshDeserialize;
use std::sync::Arc;
use zk0_circuits::{Digest, NodeId};
use zk0_ledger::blobs::{BlobError, Blobs};
use zk0_ledger::store::reader::LedgerReader;
use zk0_protocol::blob::{blob_digest, Blob};
use zk0_protocol::entries::authentic::{Authentic, AuthenticBody};
use zk0_protocol::entries::entry::{Body, MAX_ENTRY_BYTES};
use zk0_protocol::entries::genesis::Genesis;
use zk0_protocol::entries::member::NodeEnrolled;
use zk0_protocol::entries::member::Standing;
use zk0_protocol::entries::proposal::Action;
use zk0_protocol::entries::refusal::code::RoundFile;
use zk0_protocol::entries::signed::{
    DatasetRegistration, Enrolment, SignableStatement, UpdateCommitment, UploadRequest,
};
use zk0_protocol::rpc::federation::record_request::Statement;
use zk0_protocol::rpc::federation::turned_down::Remedy;
use zk0_protocol::rpc::federation::RecordRequest;
use zk0_protocol::rules::named_blobs::BlobKind;
use zk0_protocol::tlog::receipt::Receipt;
use zk0_protocol::RefusalCode;
use zk0_verifier::dataset::check_leaf_list;

/// A statement as it was sent, with valid signatures.
pub struct SentStatement {
    /// What the ledger records of it.
    body: AuthenticBody,
    signer: NodeId,
    /// SHA-256 of the statement as it was sent.
    digest: Digest,
    /// Of an enrolment, whose entry does not name it.
    enrols_in: Option<Digest>,
    /// Drawn frames of a dataset registration.
    leaves: Vec<u8>,
}

/// An allowed statement, and where its files lie.
pub struct AllowedStatement {
    sent: Arc<SentStatement>,
    genesis: Genesis,
    blobs: Blobs,
    staging: Staging,
    /// The first recent registration of its signer, if the quota is used up.
    registered: Option<u64>,
    /// Weights that it proposes to restore.
    restored: Option<Digest>,
    time_ms: u64,
}

impl SentStatement {
    /// Reads the message of a request, and verifies its signatures.
    ///
    /// # Errors
    /// It is not a statement, or a signature is wrong.
    pub fn read(request: RecordRequest) -> Result<Self, RequestError> {
        let (bytes, (body, signer, enrols_in)) = match request.statement {
            Some(Statement::Body(bytes)) => {
                let (body, signer) = read_body(&bytes)?;
                (bytes, (body, signer, None))
            }
            Some(Statement::Enrolment(bytes)) => {
                let enrolment = read_enrolment(&bytes)?;
                (bytes, enrolment)
            }
            None => {
                let why = "the request has no statement to record";
                return Err(RequestError::Malformed(why.into()));
            }
        };
        let leaves = request.leaves;
        if !leaves.is_empty() && !matches!(&*body, Body::DatasetCommitted(_)) {
            let why =
                "a list of drawn frames comes with a dataset registration, and with nothing else";
            return Err(RequestError::Malformed(why.into()));
        }
        Ok(Self {
            body,
            signer,
            digest: blob_digest(&bytes),
            enrols_in,
            leaves,
        })
    }

    /// Its signer.
    pub fn signer(&self) -> NodeId {
        self.signer
    }

    /// SHA-256 of the statement as it was sent.
    pub fn digest(&self) -> Digest {
        self.digest
    }

    /// Whether it is a proposal or a vote, which may name other witnesses.
    pub fn governs(&self) -> bool {
        matches!(&*self.body, Body::Proposed(_) | Body::Voted(_))
    }

    /// The round that it names, if any.
    pub fn round(&self) -> Option<u64> {
        match &*self.body {
            Body::UpdateCommitted(signed) => Some(signed.statement.round),
            _ => None,
        }
    }

    /// The receipt, if `body` records this statement.
    pub fn answer(&self, receipt: Receipt, body: Body) -> Option<Receipt> {
        (*self.body == body).then_some(receipt)
    }

    /// Logs that it is recorded.
    pub fn log(&self) {
        match &*self.body {
            Body::DatasetCommitted(signed) => {
                let DatasetRegistration { node, dataset, .. } = &signed.statement;
                tracing::info!(%node, samples = dataset.samples, "dataset registered");
            }
            Body::UpdateCommitted(signed) => {
                let UpdateCommitment {
                    node,
                    round,
                    update,
                    ..
                } = &signed.statement;
                tracing::info!(%node, round, update = %update.blob, "update committed");
            }
            Body::NodeEnrolled(NodeEnrolled { node, name }) => {
                tracing::info!(%node, name, "node enrolled");
            }
            _ => {}
        }
    }
}

fn read_body(bytes: &[u8]) -> Result<(AuthenticBody, NodeId), RequestError> {
    let body: Body = decode("entry to record", bytes)?;
    let signer = match &body {
        Body::DatasetCommitted(signed) => signed.statement.signer(),
        Body::UpdateCommitted(signed) => signed.statement.signer(),
        Body::Proposed(signed) => signed.statement.signer(),
        Body::Voted(signed) => signed.statement.signer(),
        Body::Disputed(signed) => signed.statement.signer(),
        Body::KeyRotated { rotation, .. } => rotation.statement.signer(),
        Body::NodeLeft(signed) => signed.statement.signer(),
        Body::OperatorDecided(signed) => signed.statement.signer(),
        _ => {
            return Err(RequestError::Malformed(
                "the entry to record is neither a proposal nor a vote, a dispute, a change of key, the leaving of a node, a decision of the operator, a dataset registration, or a commitment to an update".into(),
            ))
        }
    };
    Ok((AuthenticBody::of(body)?, signer))
}

fn read_enrolment(bytes: &[u8]) -> Result<(AuthenticBody, NodeId, Option<Digest>), RequestError> {
    let signed = read_signed::<Enrolment>("enrolment", bytes)?;
    let Enrolment {
        network,
        operator,
        node,
        name,
    } = signed.statement.clone();
    let body = AuthenticBody::of(Body::NodeEnrolled(NodeEnrolled { node, name }))?;
    Ok((body, operator, Some(network)))
}

impl AllowedStatement {
    /// Checks and keeps its files. `ledger` has the entries.
    pub fn keep(self, ledger: &LedgerReader) -> Result<AuthenticBody, RequestError> {
        match &*self.sent.body {
            Body::DatasetCommitted(signed) => {
                self.check_registrations(ledger)?;
                self.keep_leaves(&signed.statement)?;
            }
            Body::UpdateCommitted(signed) => self.keep_update(&signed.statement)?,
            Body::Proposed(signed) => self.check_proposed(&signed.statement.action)?,
            _ => {}
        }
        Ok(self.sent.body.clone())
    }

    fn check_registrations(&self, ledger: &LedgerReader) -> Result<(), RequestError> {
        let Some(first) = self.registered else {
            return Ok(());
        };
        let again_ms = ledger.entry(first)?.time_ms.saturating_add(PERIOD_MS);
        match again_ms.saturating_sub(self.time_ms) {
            0 => Ok(()),
            left_ms => Err(RequestError::Busy {
                why: format!(
                    "node {} has registered {MAX_REGISTRATIONS} datasets within a day, and no round has closed since: it may register again when a round has closed, or in {} minutes",
                    self.sent.signer,
                    left_ms.div_ceil(60_000)
                ),
                remedy: Remedy::NextRound,
            }),
        }
    }

    fn keep_leaves(&self, registration: &DatasetRegistration) -> Result<(), RequestError> {
        let list = Blob::from(&self.sent.leaves[..]);
        if list.digest() != registration.leaves {
            let detail = format!(
                "the list of drawn frames has SHA-256 {}, the registration names {}",
                list.digest(),
                registration.leaves
            );
            return Err(RefusalCode::Dataset.because(detail).into());
        }
        check_leaf_list(registration, &self.sent.leaves)?;
        self.blobs.put(&list)?;
        Ok(())
    }

    fn keep_update(&self, commitment: &UpdateCommitment) -> Result<(), RequestError> {
        let staged = self.staging.of(commitment.round, &commitment.node);
        let update = commitment.update.blob;
        match self.blobs.link(&staged, &update) {
            Err(BlobError::Missing(_)) => Err(RefusalCode::MissingUpdate(update).into()),
            kept => Ok(kept?),
        }
    }

    /// Refuses missing or unusable public samples, with which no round could close, and lost weights, from which none could start.
    fn check_proposed(&self, action: &Action) -> Result<(), RequestError> {
        match action {
            Action::ChangeRules(rules) => {
                let checked = check_public_samples(&self.genesis, rules, &self.blobs);
                checked.map_err(RequestError::PublicSamples)?;
                // The operator puts the file into the ledger's folder.
                if let Some(samples) = &rules.public_samples {
                    self.blobs.keeps(&samples.blob)?;
                }
            }
            Action::RestoreWeights { round } => {
                let lost = self.restored.filter(|blob| !self.blobs.contains(blob));
                if let Some(blob) = lost {
                    return Err(RequestError::LostWeights {
                        round: *round,
                        blob,
                    });
                }
            }
            _ => {}
        }
        Ok(())
    }
}

impl Aggregator {
    /// First step for a statement that arrived at `arrived_ms`.
    pub fn begin_statement(
        &self,
        sent: Arc<SentStatement>,
        arrived_ms: u64,
    ) -> Comparison<AllowedStatement> {
        match self.check_enrolment(&sent) {
            Ok(()) => Comparison {
                earlier: self.earlier(&sent),
                published_key: self.published_key(),
                allowed: self.allowed(sent, arrived_ms),
            },
            Err(refused) => Comparison {
                earlier: None,
                published_key: None,
                allowed: Err(refused),
            },
        }
    }

    fn check_enrolment(&self, sent: &SentStatement) -> Result<(), RequestError> {
        let (ours, state) = (*self.state().network(), self.state());
        // The operator leaves enrolments to the log's key, if that is another one.
        let operators = [&state.genesis().log_key, state.log_keys().present()];
        match sent.enrols_in {
            Some(claimed) if claimed != ours => {
                Err(RefusalCode::WrongNetwork { claimed, ours }.into())
            }
            Some(_) if !operators.contains(&&sent.signer.0) => {
                Err(RequestError::NotOperator(sent.signer))
            }
            _ => Ok(()),
        }
    }

    /// The entry that may have recorded this statement.
    fn earlier(&self, sent: &SentStatement) -> Option<u64> {
        let state = self.state();
        match &*sent.body {
            Body::DatasetCommitted(_) => Some(state.node(&sent.signer)?.dataset?.entry),
            Body::UpdateCommitted(signed) => {
                let round = signed.statement.round;
                let open = state.round().filter(|open| open.number() == round)?;
                Some(open.commits.get(&sent.signer)?.entry)
            }
            // A node may leave, be enrolled again, and leave once more.
            Body::NodeLeft(_) if !self.has_left(&sent.signer) => None,
            Body::NodeEnrolled(enrolled) if self.has_left(&enrolled.node) => None,
            body => self.index.reported(body),
        }
    }

    fn has_left(&self, node: &NodeId) -> bool {
        let known = self.state().node(node);
        known.is_some_and(|known| known.standing == Standing::Left)
    }

    fn allowed(
        &self,
        sent: Arc<SentStatement>,
        arrived_ms: u64,
    ) -> Result<AllowedStatement, RequestError> {
        self.check(arrived_ms, &sent.body)?;
        let restored = match &*sent.body {
            Body::Proposed(signed) => match signed.statement.action {
                Action::RestoreWeights { round } => self.state().results().of(round),
                _ => None,
            },
            _ => None,
        };
        Ok(AllowedStatement {
            genesis: self.state().genesis().clone(),
            blobs: self.ledger.blobs().clone(),
            staging: self.staging.clone(),
            registered: self.index.registrations.first(&sent.signer),
            restored: restored.map(|result| result.blob),
            time_ms: self.ledger.time_ms(arrived_ms),
            sent,
        })
    }

    /// Begins an upload of a node that may commit. The caller reads and writes at the returned place, away from the aggregator. `None` if
    /// the node has committed to this update, and all of it is here, as after a restart. A lost update is uploaded again.
    pub fn begin_upload(&self, request: &UploadRequest) -> Result<Option<Staging>, RequestError> {
        let (state, limit) = (
            self.state(),
            BlobKind::Update.max_bytes(self.state().rules()),
        );
        let UploadRequest {
            network,
            round,
            node,
            blob,
            size,
        } = request;
        let open = state.round().filter(|open| open.number() == *round);
        let committed = open.and_then(|open| open.commits.get(node));
        let is_committed = committed.is_some_and(|commit| commit.update.blob == *blob);
        if is_committed && network == state.network() {
            let is_lost = self.lost_update(request).is_some();
            return Ok(is_lost.then(|| self.staging.clone()));
        }
        state.check_may_commit(network, *round, node)?;
        if *size > limit {
            let (file, size) = (RoundFile::Update, *size);
            return Err(RefusalCode::TooLarge { file, size, limit }.into());
        }
        Ok(Some(self.staging.clone()))
    }
}

/// Decodes a signed statement, and verifies its signature.
pub fn read_signed<T: SignableStatement>(
    what: &str,
    bytes: &[u8],
) -> Result<Authentic<T>, RequestError> {
    Ok(Authentic::of(decode(what, bytes)?)?)
}

/// Decodes a signed statement: exactly these bytes, within an entry's limit.
pub fn decode<T: BorshDeserialize>(what: &str, bytes: &[u8]) -> Result<T, RequestError> {
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
