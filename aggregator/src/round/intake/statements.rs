//! Recording what nodes and members send, in three steps. The first one compares a request with the ledger. The second one reads and writes
//! files, and needs no aggregator, so that the rounds go on meanwhile. The third one records ([`crate::round::intake::group`]), and compares once more.
//!
//! What is recorded already is not recorded again: whoever sends it again gets the same receipt. [`crate::round::intake::submission`] has the
//! same steps for submissions.

use crate::round::aggregator::Aggregator;
use crate::round::intake::registrations::{MAX_REGISTRATIONS, PERIOD_MS};
use crate::round::intake::staging::Staging;
use crate::round::public_samples::check_public_samples;
use crate::round::request_error::RequestError;
use borsh::BorshDeserialize;
use zk0_circuits::NodeId;
use zk0_ledger::blobs::{BlobError, Blobs};
use zk0_protocol::blob::Blob;
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
use zk0_protocol::rules::named_blobs::BlobKind;
use zk0_protocol::tlog::receipt::Receipt;
use zk0_protocol::RefusalCode;
use zk0_verifier::dataset::check_leaf_list;

/// What the first step finds.
pub enum Admission<T, R = Receipt> {
    /// It is recorded already: this is the answer.
    Recorded(R),
    /// It is new, and the rules allow it so far. This is what the second step needs.
    New(T),
}

/// What a member says about the network itself: a proposal, a vote, a dispute, a change of key, or that it leaves, as it was signed.
pub struct MemberStatement {
    body: AuthenticBody,
    signer: NodeId,
}

/// Something said that the rules allow, and the samples that it proposes.
pub struct AllowedStatement {
    body: AuthenticBody,
    genesis: Genesis,
    blobs: Blobs,
}

/// A dataset commitment that the rules allow.
pub struct AllowedRegistration {
    signed: Authentic<DatasetRegistration>,
    blobs: Blobs,
}

/// A commitment that the rules allow, to an update that its node has uploaded.
pub struct AllowedCommitment {
    signed: Authentic<UpdateCommitment>,
    staged: Blobs,
    blobs: Blobs,
}

impl MemberStatement {
    /// Reads the bytes of an entry's body, and verifies its signatures.
    ///
    /// # Errors
    /// It is not something that a member may state, or a signature is wrong.
    pub fn read(bytes: &[u8]) -> Result<Self, RequestError> {
        let body: Body = decode("entry to record", bytes)?;
        let signer = match &body {
            Body::Proposed(signed) => signed.statement.signer(),
            Body::Voted(signed) => signed.statement.signer(),
            Body::Disputed(signed) => signed.statement.signer(),
            Body::KeyRotated { rotation, .. } => rotation.statement.signer(),
            Body::NodeLeft(signed) => signed.statement.signer(),
            _ => {
                return Err(RequestError::Malformed(
                    "the entry to record is neither a proposal nor a vote, a dispute, a change of key, or the leaving of a node".into(),
                ))
            }
        };
        let body = AuthenticBody::of(body)?;
        Ok(Self { body, signer })
    }

    /// Who states it.
    pub fn signer(&self) -> NodeId {
        self.signer
    }
}

impl AllowedStatement {
    /// Refuses a proposal of public samples that are not at hand or cannot be used, because no round could be closed with them.
    pub fn check(self) -> Result<AuthenticBody, RequestError> {
        if let Body::Proposed(signed) = &*self.body {
            if let Action::ChangeRules(rules) = &signed.statement.action {
                let checked = check_public_samples(&self.genesis, rules, &self.blobs);
                checked.map_err(RequestError::PublicSamples)?;
                // The operator puts the file into the ledger's folder.
                if let Some(samples) = &rules.public_samples {
                    self.blobs.keeps(&samples.blob)?;
                }
            }
        }
        Ok(self.body)
    }
}

impl AllowedRegistration {
    /// Keeps the list of drawn frames as a blob, if it is the one that the registration names.
    pub fn keep(self, leaves: &[u8]) -> Result<AuthenticBody, RequestError> {
        let registration = &self.signed.statement;
        let list = Blob::from(leaves);
        if list.digest() != registration.leaves {
            let detail = format!(
                "the list of drawn frames has SHA-256 {}, the registration names {}",
                list.digest(),
                registration.leaves
            );
            return Err(RefusalCode::Dataset.because(detail).into());
        }
        check_leaf_list(registration, leaves)?;
        self.blobs.put(&list)?;
        Ok(self.signed.into())
    }
}

impl AllowedCommitment {
    /// Puts the uploaded update among the ledger's blobs.
    pub fn keep(self) -> Result<AuthenticBody, RequestError> {
        let update = self.signed.statement.update.blob;
        match self.blobs.link(&self.staged, &update) {
            Err(BlobError::Missing(_)) => Err(RefusalCode::MissingUpdate(update).into()),
            kept => {
                kept?;
                Ok(self.signed.into())
            }
        }
    }
}

impl Aggregator {
    /// Begins to record what a member says.
    pub fn begin_statement(
        &self,
        said: &MemberStatement,
        arrived_ms: u64,
    ) -> Result<Admission<AllowedStatement>, RequestError> {
        // A node may leave, be enrolled again, and leave once more.
        let undone = matches!(*said.body, Body::NodeLeft(_)) && !self.has_left(&said.signer);
        if let Some(index) = self.index.said(&said.body).filter(|_| !undone) {
            return Ok(Admission::Recorded(self.ledger.first_receipt(index)?));
        }
        self.check(arrived_ms, &said.body)?;
        self.check_at_hand(&said.body)?;
        Ok(Admission::New(AllowedStatement {
            body: said.body.clone(),
            genesis: self.state().genesis().clone(),
            blobs: self.ledger.blobs().clone(),
        }))
    }

    fn has_left(&self, node: &NodeId) -> bool {
        let known = self.state().node(node);
        known.is_some_and(|known| known.standing == Standing::Left)
    }

    /// Refuses a proposal to go back to weights whose blob is lost, because no round could start from them.
    fn check_at_hand(&self, body: &Body) -> Result<(), RequestError> {
        let Body::Proposed(signed) = body else {
            return Ok(());
        };
        let Action::RestoreWeights { round } = signed.statement.action else {
            return Ok(());
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

    /// Begins to record a dataset commitment.
    ///
    /// # Errors
    /// The rules do not allow it, or the node has registered too often ([`crate::round::intake::registrations`]).
    pub fn begin_registration(
        &self,
        signed: Authentic<DatasetRegistration>,
        arrived_ms: u64,
    ) -> Result<Admission<AllowedRegistration>, RequestError> {
        let known = self.state().node(&signed.statement.node);
        let body = AuthenticBody::from(signed.clone());
        if let Some(known) = known.and_then(|known| known.dataset) {
            if self.ledger.entry(known.entry)?.body == *body {
                return Ok(Admission::Recorded(self.ledger.first_receipt(known.entry)?));
            }
        }
        self.check(arrived_ms, &body)?;
        self.check_registrations(&signed.statement.node, arrived_ms)?;
        Ok(Admission::New(AllowedRegistration {
            signed,
            blobs: self.ledger.blobs().clone(),
        }))
    }

    /// Refuses a node that has registered as often as it may.
    fn check_registrations(&self, node: &NodeId, arrived_ms: u64) -> Result<(), RequestError> {
        let Some(first) = self.index.registrations.first(node) else {
            return Ok(());
        };
        let again_ms = (self.ledger.entry(first)?.time_ms).saturating_add(PERIOD_MS);
        match again_ms.saturating_sub(self.ledger.time_ms(arrived_ms)) {
            0 => Ok(()),
            left_ms => Err(RequestError::Busy(format!(
                "node {node} has registered {MAX_REGISTRATIONS} datasets within a day, and no round has closed since: it may register again when a round has closed, or in {} minutes",
                left_ms.div_ceil(60_000)
            ))),
        }
    }

    /// Begins to enrol a node.
    ///
    /// # Errors
    /// Somebody else than the network's operator has signed it, or the rules do not let the operator enrol this node.
    pub fn begin_enrolment(
        &self,
        signed: &Authentic<Enrolment>,
        arrived_ms: u64,
    ) -> Result<Admission<AuthenticBody>, RequestError> {
        let Enrolment {
            network,
            operator,
            node,
            name,
        } = &signed.statement;
        let genesis = self.state().genesis();
        if network != self.state().network() {
            let code = RefusalCode::WrongNetwork {
                claimed: *network,
                ours: *self.state().network(),
            };
            return Err(code.into());
        }
        if operator.0 != genesis.log_key {
            return Err(RequestError::NotOperator(*operator));
        }
        let body = AuthenticBody::of(Body::NodeEnrolled(NodeEnrolled {
            node: *node,
            name: name.clone(),
        }))?;
        let left = self.has_left(node);
        if let Some(index) = self.index.said(&body).filter(|_| !left) {
            return Ok(Admission::Recorded(self.ledger.first_receipt(index)?));
        }
        self.check(arrived_ms, &body)?;
        Ok(Admission::New(body))
    }

    /// Begins an upload. Whoever may not commit may not upload. If it is new, this says where it waits. The caller reads and writes there, away
    /// from the aggregator. If the node has committed to this very update, all of it is here: a node that was started again asks for that.
    pub fn begin_upload(
        &self,
        request: &UploadRequest,
    ) -> Result<Admission<Staging, ()>, RequestError> {
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
        let is_here = committed.is_some_and(|commit| commit.update.blob == *blob);
        if is_here && network == state.network() {
            return Ok(Admission::Recorded(()));
        }
        state.check_may_commit(network, *round, node)?;
        if *size > limit {
            let (file, size) = (RoundFile::Update, *size);
            return Err(RefusalCode::TooLarge { file, size, limit }.into());
        }
        Ok(Admission::New(self.staging.clone()))
    }

    /// Begins to record a commitment to an uploaded update.
    pub fn begin_commitment(
        &self,
        signed: Authentic<UpdateCommitment>,
        arrived_ms: u64,
    ) -> Result<Admission<AllowedCommitment>, RequestError> {
        let UpdateCommitment { node, round, .. } = signed.statement;
        let body = AuthenticBody::from(signed.clone());
        let open = self.state().round().filter(|open| open.number() == round);
        if let Some(commit) = open.and_then(|open| open.commits.get(&node)) {
            if self.ledger.entry(commit.entry)?.body == *body {
                return Ok(Admission::Recorded(
                    self.ledger.first_receipt(commit.entry)?,
                ));
            }
        }
        self.check(arrived_ms, &body)?;
        Ok(Admission::New(AllowedCommitment {
            staged: self.staging.of(round, &node),
            signed,
            blobs: self.ledger.blobs().clone(),
        }))
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
