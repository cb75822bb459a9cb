//! Recording what nodes, members and the operator sign, in three steps. The first one compares a statement with the ledger's state. The second one
//! reads and writes files, and needs no aggregator, so that the rounds go on meanwhile. The third one records ([`crate::round::intake::group`]), and
//! compares once more. Signatures are verified before all of them ([`SentStatement::read`]).
//!
//! What is recorded already is not recorded again: whoever sends it again gets the same receipt. [`crate::round::intake::submission`] has the
//! same steps for submissions.

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

/// A statement as somebody has signed and sent it. Its signatures are valid.
pub struct SentStatement {
    /// What the ledger records of it.
    body: AuthenticBody,
    signer: NodeId,
    /// SHA-256 of the statement as it was sent.
    digest: Digest,
    /// The network that an enrolment is for. Its entry does not name one.
    enrols_in: Option<Digest>,
    /// The list of drawn frames that comes with a dataset registration.
    leaves: Vec<u8>,
}

/// A statement that the rules allow, and where the files lie that belong to it.
pub struct AllowedStatement {
    sent: Arc<SentStatement>,
    genesis: Genesis,
    blobs: Blobs,
    staging: Staging,
    /// The first of the datasets that its signer has registered lately, if these are as many as a node may register.
    registered: Option<u64>,
    /// The weights to which it proposes to go back.
    restored: Option<Digest>,
    time_ms: u64,
}

impl SentStatement {
    /// Reads the message of a request, and verifies the signatures in it.
    ///
    /// # Errors
    /// It is not something that somebody may state, or a signature is wrong.
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

    /// Who states it.
    pub fn signer(&self) -> NodeId {
        self.signer
    }

    /// SHA-256 of the statement as it was sent.
    pub fn digest(&self) -> Digest {
        self.digest
    }

    /// The round that it is about, if it names one.
    pub fn round(&self) -> Option<u64> {
        match &*self.body {
            Body::UpdateCommitted(signed) => Some(signed.statement.round),
            _ => None,
        }
    }

    /// The receipt of an entry with this body, if it is this statement that it records.
    pub fn answer(&self, receipt: Receipt, body: Body) -> Option<Receipt> {
        (*self.body == body).then_some(receipt)
    }

    /// Tells the log that it is recorded.
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

/// The body of an entry, with its signer.
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

/// What the ledger records of an enrolment, with its signer and its network.
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
    /// Checks and keeps the files that belong to it. `ledger` has the entries.
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

    /// Refuses a node that has registered as often as it may.
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

    /// Keeps the list of drawn frames as a blob, if it is the one that the registration names.
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

    /// Puts the uploaded update among the ledger's blobs.
    fn keep_update(&self, commitment: &UpdateCommitment) -> Result<(), RequestError> {
        let staged = self.staging.of(commitment.round, &commitment.node);
        let update = commitment.update.blob;
        match self.blobs.link(&staged, &update) {
            Err(BlobError::Missing(_)) => Err(RefusalCode::MissingUpdate(update).into()),
            kept => Ok(kept?),
        }
    }

    /// Refuses public samples that are not at hand or cannot be used, because no round could be closed with them, and weights whose blob is
    /// lost, because no round could start from them.
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
    /// Begins to record a statement that arrived at `arrived_ms`: compares it with the ledger's state.
    pub fn begin_statement(
        &self,
        sent: Arc<SentStatement>,
        arrived_ms: u64,
    ) -> Comparison<AllowedStatement> {
        match self.check_enrolment(&sent) {
            Ok(()) => Comparison {
                earlier: self.earlier(&sent),
                allowed: self.allowed(sent, arrived_ms),
            },
            Err(refused) => Comparison {
                earlier: None,
                allowed: Err(refused),
            },
        }
    }

    /// Checks that it is this network's operator who enrols.
    fn check_enrolment(&self, sent: &SentStatement) -> Result<(), RequestError> {
        let (ours, genesis) = (*self.state().network(), self.state().genesis());
        match sent.enrols_in {
            Some(claimed) if claimed != ours => {
                Err(RefusalCode::WrongNetwork { claimed, ours }.into())
            }
            Some(_) if sent.signer.0 != genesis.log_key => {
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
            body => self.index.said(body),
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

    /// Begins an upload. Whoever may not commit may not upload. This says where it waits: the caller reads and writes there, away from the
    /// aggregator. `None` if the node has committed to this very update, and all of it is here: a node that was started again asks for that.
    /// An update that was lost since is uploaded again.
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

/// Decodes a statement as it was signed: exactly these bytes, and not too many of them.
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
