//! A node's connection to an aggregator. The node does not trust it: it knows the network's id, and demands a receipt for each entry.

pub mod carried;
mod heads;
mod opened;
mod seen_keys;
pub mod status;
pub mod stored_update;
mod transfers;
mod waits;
pub mod watching;

use crate::client::heads::{run, system_clock, About, For};
use crate::client::seen_keys::SeenKeys;
use crate::client::stored_update::StoreClient;
use crate::client::waits::{may_pass, why, Waits};
use crate::client_error::NodeError;
use crate::observe::{AskedService, NodeMetrics};
use ed25519_dalek::SigningKey;
use sha2::{Digest as _, Sha256};
use std::path::Path;
use std::time::Duration;
use tonic::service::interceptor::InterceptedService;
use tonic::{transport, Status};
use tracing::instrument;
use zk0_circuits::{Claim, Digest, NodeId, WeightsDigest};
use zk0_protocol::challenge::closing;
use zk0_protocol::entries::entry::{Body, Entry};
use zk0_protocol::entries::genesis::Genesis;
use zk0_protocol::entries::program::Program;
use zk0_protocol::entries::signed::{
    DatasetRegistration, Proposal, SignatureError, Signed, Submission, UpdateCommitment,
};
use zk0_protocol::quote::short;
use zk0_protocol::request_head::Method;
use zk0_protocol::rpc::federation as rpc;
use zk0_protocol::rpc::federation::federation_client::FederationClient;
use zk0_protocol::rpc::federation::record_request::Statement;
use zk0_protocol::rpc::head_metadata::with_head;
use zk0_protocol::rpc::PROTOCOL;
use zk0_protocol::tlog::receipt::Receipt;
use zk0_protocol::{Refusal, Rules};
use zk0_service::tls::service_address::ServiceAddress;
use zk0_service::traces::carried::Carrier;

/// A receipt or a chunk is far smaller.
const MAX_MESSAGE_BYTES: usize = 4 << 20;

/// Most characters of an aggregator's sentence about its release.
const MAX_RELEASE_CHARS: usize = 200;

/// Makes a request, and repeats it while the aggregator does not answer or cannot grant it. The same request has the same result. Each
/// attempt makes `$request` again, because the head of a request counts once.
macro_rules! patiently {
    ($self:ident.client.$method:ident($request:expr)) => {{
        let mut waits = Waits::default();
        let answer = loop {
            let request = $request;
            match $self.client.$method(request).await {
                Ok(answer) => break answer,
                Err(failure) => $self.again(&mut waits, failure).await?,
            }
        };
        waits.end();
        $self.metrics.answered(AskedService::Aggregator);
        answer
    }};
}

/// A node of one network, connected to its aggregator.
pub struct NodeClient {
    pub(crate) client: FederationClient<InterceptedService<transport::Channel, Carrier>>,
    key: SigningKey,
    genesis: Genesis,
    seen_keys: SeenKeys,
    /// The round that the node has seen open, and the log's key there: that draws its randomness.
    pub(crate) opening: Option<(u64, [u8; 32])>,
    heads: For,
    store: StoreClient,
    /// How long the node waits for an answer; `None` for no limit.
    patience: Option<Duration>,
    metrics: NodeMetrics,
}

/// The aggregator's decision on a submission.
#[derive(Clone, Debug)]
pub struct SubmissionDecision {
    /// Why the submission is refused; `None` if it is accepted.
    pub refusal: Option<Refusal>,
    /// Shows that the decision is on the ledger.
    pub receipt: Receipt,
}

/// The present governance of a network.
#[derive(Clone, Debug)]
pub struct GovernanceInfo {
    /// The rules in force.
    pub rules: Rules,
    /// Number of the next proposal.
    pub next_proposal: u64,
    /// Number of the operator's next decision about a node.
    pub next_decision: u64,
    /// Open proposals and their votes so far.
    pub proposals: Vec<(Proposal, rpc::OpenProposal)>,
    /// The aggregator's time in milliseconds.
    pub now_ms: u64,
    /// The guest program in force.
    pub program: Program,
    /// Too few witnesses cosign, so this shows entries that are not published.
    pub not_cosigned: bool,
}

pub(crate) fn unexpected(expected: &str, found: impl Into<String>) -> NodeError {
    NodeError::Unexpected {
        expected: expected.into(),
        found: found.into(),
    }
}

impl NodeClient {
    /// Connects to the aggregator of `network` at `address`.
    pub async fn connect(
        address: impl Into<ServiceAddress>,
        network: Digest,
        key: SigningKey,
    ) -> Result<Self, NodeError> {
        Self::connect_with(address.into(), key, SeenKeys::of(network)).await
    }

    /// [`NodeClient::connect`], of a node that keeps in its folder `state` which key of the log it has seen.
    pub async fn connect_keeping(
        address: impl Into<ServiceAddress>,
        network: Digest,
        key: SigningKey,
        state: &Path,
    ) -> Result<Self, NodeError> {
        let seen_keys = SeenKeys::kept_in(state, network)?;
        Self::connect_with(address.into(), key, seen_keys).await
    }

    async fn connect_with(
        address: ServiceAddress,
        key: SigningKey,
        seen_keys: SeenKeys,
    ) -> Result<Self, NodeError> {
        let network = seen_keys.network();
        let channel = address.connect().await?;
        let mut client = FederationClient::with_interceptor(channel, Carrier)
            .max_decoding_message_size(MAX_MESSAGE_BYTES);
        let info = client.get_network(rpc::GetNetworkRequest {}).await;
        let info = info
            .map_err(|status| match address.first_failure(&status) {
                Some(error) => error.into(),
                None => NodeError::from(status),
            })?
            .into_inner();
        if info.protocol != PROTOCOL {
            return Err(NodeError::OtherProtocol {
                theirs: info.protocol,
                release: info.release.chars().take(MAX_RELEASE_CHARS).collect(),
            });
        }
        let entry = Entry::decode(&info.genesis)?;
        let Body::Genesis(genesis) = entry.body else {
            return Err(unexpected("a genesis", "another entry"));
        };
        let theirs = genesis.network_id();
        if theirs != network {
            return Err(NodeError::OtherNetwork {
                ours: network,
                theirs,
            });
        }
        let client = Self {
            client,
            key,
            genesis,
            seen_keys,
            opening: None,
            store: StoreClient::beside(&address),
            patience: None,
            metrics: NodeMetrics::default(),
            heads: For {
                network,
                run: run(&info.run)?,
                clock: Box::new(system_clock),
            },
        };
        client.open_checkpoint(info.checkpoint.as_bytes())?;
        Ok(client)
    }

    /// Signs the times of this clock, in Unix milliseconds, instead of the machine's.
    pub fn by_clock(mut self, clock: impl Fn() -> u64 + Send + Sync + 'static) -> Self {
        self.heads.clock = Box::new(clock);
        self
    }

    /// Makes requests fail that would wait longer than `limit`. Otherwise they wait without limit.
    pub fn giving_up_after(mut self, limit: Duration) -> Self {
        self.patience = Some(limit);
        self
    }

    /// What the node counts.
    pub fn metrics(&self) -> &NodeMetrics {
        &self.metrics
    }

    /// The network's genesis.
    pub fn genesis(&self) -> &Genesis {
        &self.genesis
    }

    /// The network's id.
    pub fn network(&self) -> &Digest {
        &self.heads.network
    }

    pub(crate) fn key(&self) -> &SigningKey {
        &self.key
    }

    /// The node's identity.
    pub fn id(&self) -> NodeId {
        NodeId(self.key.verifying_key().to_bytes())
    }

    /// Puts a dataset on the ledger. `leaves` is the list of drawn frames. A node that was restarted gets a receipt of the same entry.
    pub async fn register(
        &mut self,
        registration: DatasetRegistration,
        leaves: Vec<u8>,
    ) -> Result<Receipt, NodeError> {
        let body = Body::DatasetCommitted(Signed::new(registration, &self.key));
        let statement = Statement::Body(encode(&body));
        self.stated(statement, leaves, body).await
    }

    /// The guest program in force, as the aggregator states it.
    pub async fn program(&mut self) -> Result<Program, NodeError> {
        let request = rpc::GetRoundRequest {
            round: None,
            node: Vec::new(),
        };
        let info = patiently!(self.client.get_round(request.clone())).into_inner();
        program(&info.program)
    }

    /// The accepted update of this node in a SCAFFOLD round, for its control variates.
    pub async fn accepted_update(&mut self, round: u64) -> Result<WeightsDigest, NodeError> {
        let request = rpc::GetRoundRequest {
            round: Some(round),
            node: self.id().0.to_vec(),
        };
        let wanted = "the contribution of this node that the round has accepted";
        let info = patiently!(self.client.get_round(request.clone())).into_inner();
        let contribution = info.contribution;
        let contribution = contribution.ok_or_else(|| unexpected(wanted, "none"))?;
        let Body::ContributionAccepted(signed) = self.entry(contribution)?.1.body else {
            return Err(unexpected(wanted, "another entry"));
        };
        let terms = &signed.statement.claim.terms;
        let of = (terms.network, terms.round, terms.node);
        if of == (*self.network(), round, self.id()) && signed.verify().is_ok() {
            Ok(terms.update)
        } else {
            Err(unexpected(wanted, "another contribution"))
        }
    }

    pub(crate) async fn next_round(&mut self) -> Result<u64, NodeError> {
        let request = rpc::GetRoundRequest {
            round: None,
            node: Vec::new(),
        };
        let info = patiently!(self.client.get_round(request.clone())).into_inner();
        let Some(opened) = info.opened else {
            return Ok(0);
        };
        match self.entry(opened)?.1.body {
            Body::RoundOpened(opened) => Ok(opened.round.saturating_add(1)),
            _ => Err(unexpected("the opening of a round", "another entry")),
        }
    }

    /// Commits to an uploaded update, to be evaluated on `eval_samples` samples. Returns the commitment's digest, from which the challenge
    /// will follow, and the receipt.
    #[instrument(name = "commit", skip_all)]
    pub async fn commit(
        &mut self,
        round: u64,
        dataset_root: &Digest,
        update: &WeightsDigest,
        eval_samples: u32,
    ) -> Result<(Digest, Receipt), NodeError> {
        let statement = UpdateCommitment {
            network: self.heads.network,
            round,
            node: self.id(),
            dataset_root: *dataset_root,
            update: *update,
            eval_samples,
        };
        let commitment = closing::commitment(&statement);
        let body = Body::UpdateCommitted(Signed::new(statement, &self.key));
        let statement = Statement::Body(encode(&body));
        let receipt = self.stated(statement, Vec::new(), body).await?;
        Ok((commitment, receipt))
    }

    /// Signs a claim and submits it with its proof.
    #[instrument(name = "submit", skip_all)]
    pub async fn submit(
        &mut self,
        claim: Claim,
        proof: Vec<u8>,
    ) -> Result<SubmissionDecision, NodeError> {
        let round = claim.terms.round;
        let signed = Signed::new(
            Submission {
                claim,
                proof: Digest(Sha256::digest(&proof).into()),
            },
            &self.key,
        );
        let submission = encode(&signed);
        let about = About::message(Method::Submit, &submission).in_round(round);
        let message = rpc::SubmitRequest { submission, proof };
        let reply = patiently!(self.client.submit(self.headed(&about, message.clone())?));
        let reply = reply.into_inner();
        let receipt = reply
            .receipt
            .ok_or_else(|| unexpected("a receipt of the decision", "none"))?;
        let (receipt, _, entry) = self.opened(receipt)?;
        let (submission, refusal) = match entry.body {
            Body::ContributionAccepted(submission) => (submission, None),
            Body::ContributionRejected { submission, reason } => {
                (submission, Some(reason.because(short(&reply.detail))))
            }
            _ => {
                return Err(unexpected(
                    "the decision on the submission",
                    "another entry",
                ))
            }
        };
        if submission != signed {
            return Err(unexpected(
                "the decision on this submission",
                "the decision on another",
            ));
        }
        Ok(SubmissionDecision { refusal, receipt })
    }

    /// Puts a proposal, a vote, a dispute, or a change of key on the ledger. Returns the entry's index.
    pub async fn record(&mut self, body: Body) -> Result<u64, NodeError> {
        let statement = Statement::Body(encode(&body));
        Ok(self.stated(statement, Vec::new(), body).await?.index)
    }

    /// Has the aggregator record a signed statement. Returns the receipt of its entry, and checks that it has this body.
    pub(crate) async fn stated(
        &mut self,
        statement: Statement,
        leaves: Vec<u8>,
        body: Body,
    ) -> Result<Receipt, NodeError> {
        let (Statement::Body(bytes) | Statement::Enrolment(bytes)) = &statement;
        let about = About::message(Method::Record, bytes);
        let about = match &body {
            Body::UpdateCommitted(signed) => about.in_round(signed.statement.round),
            _ => about,
        };
        let message = rpc::RecordRequest {
            statement: Some(statement),
            leaves,
        };
        let receipt = patiently!(self.client.record(self.headed(&about, message.clone())?));
        let receipt = receipt.into_inner();
        if receipt.not_cosigned {
            let entry = receipt.index;
            tracing::warn!(
                "entry {entry} is recorded, and counts, but too few witnesses have cosigned it yet"
            );
        }
        let (receipt, _, entry) = self.opened(receipt)?;
        if entry.body == body {
            Ok(receipt)
        } else {
            Err(unexpected(
                "a receipt of what this node signed",
                "a receipt of another entry",
            ))
        }
    }

    /// The rules in force and the open proposals. Only the proposals are proven, by receipts and signatures. For the rest, replay the
    /// ledger.
    pub async fn governance(&mut self) -> Result<GovernanceInfo, NodeError> {
        let request = rpc::GetGovernanceRequest {};
        let info = patiently!(self.client.get_governance(request)).into_inner();
        let rules: Rules = borsh::from_slice(&info.rules)
            .map_err(|error| unexpected("rules", format!("something else ({error})")))?;
        let unsigned = |error: SignatureError| {
            let found = format!("a proposal without its proposer's signature ({error})");
            unexpected("the open proposals", found)
        };
        let mut proposals = Vec::new();
        for open in info.proposals {
            let receipt = open.receipt.clone();
            let receipt = receipt.ok_or_else(|| unexpected("a receipt of a proposal", "none"))?;
            let receipt = rpc::Receipt {
                not_cosigned: info.not_cosigned,
                ..receipt
            };
            match self.entry(receipt)?.1.body {
                Body::Proposed(signed) => {
                    signed.verify().map_err(unsigned)?;
                    proposals.push((signed.statement, open));
                }
                _ => return Err(unexpected("a proposal", "another entry")),
            }
        }
        Ok(GovernanceInfo {
            rules,
            next_proposal: info.next_proposal,
            next_decision: info.next_decision,
            proposals,
            now_ms: info.now_ms,
            program: program(&info.program)?,
            not_cosigned: info.not_cosigned,
        })
    }

    fn headed<T>(&self, about: &About, message: T) -> Result<tonic::Request<T>, NodeError> {
        let head = self.heads.head(about, &self.key)?;
        Ok(with_head(message, &head))
    }

    /// Waits before a request is repeated, and asks for the run of an aggregator that may have restarted.
    ///
    /// # Errors
    /// The failure does not pass, or the node gives up.
    pub(crate) async fn again(
        &mut self,
        waits: &mut Waits,
        mut failure: Status,
    ) -> Result<(), NodeError> {
        loop {
            if may_pass(&failure) {
                self.metrics
                    .asks_again(AskedService::Aggregator, why(&failure));
            }
            waits.again(failure, self.patience).await?;
            match self.learn_run().await {
                Err(away) if may_pass(&away) => failure = away,
                _ => return Ok(()),
            }
        }
    }

    /// Asks the aggregator for its run. A bad answer shows at the next request.
    pub(crate) async fn learn_run(&mut self) -> Result<(), Status> {
        let info = self.client.get_network(rpc::GetNetworkRequest {}).await?;
        if let Ok(run) = run(&info.into_inner().run) {
            self.heads.run = run;
        }
        Ok(())
    }
}

pub(crate) fn program(bytes: &[u8]) -> Result<Program, NodeError> {
    borsh::from_slice(bytes)
        .map_err(|error| unexpected("a guest program", format!("something else ({error})")))
}

fn encode<T: borsh::BorshSerialize>(value: &T) -> Vec<u8> {
    borsh::to_vec(value).expect("writing to a Vec cannot fail")
}
