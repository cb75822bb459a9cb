//! The aggregator as a node sees it: every answer is checked against the network's id and the log's key, or it is an error.
//!
//! What can be asked again is asked again while the aggregator is away: a restarted one remembers what it has acknowledged,
//! and gives the same receipt for the same statement.

use crate::rpc::{
    self, federation_client::FederationClient, upload_chunk::Part, CommitRequest, DownloadRequest,
    GetNetworkRequest, GetRoundRequest, RegisterDatasetRequest, SubmitRequest, UploadChunk,
};
use sha2::{Digest as _, Sha256};
use std::{
    collections::BTreeMap,
    future::Future,
    sync::{Mutex, PoisonError},
    time::Duration,
};
use tokio::time::{sleep, Instant};
use tonic::{
    transport::{Channel, Endpoint},
    Code, Status,
};
use zk0_circuits::{challenge::challenge, Digest};
use zk0_ledger::{
    checkpoint::{Checkpoint, CheckpointError},
    entry::{Body, Entry, Genesis, RoundClosed, RoundOpened},
    receipt::{Receipt, ReceiptError},
    signed::{DatasetRegistration, Signed, Submission, UpdateCommitment, UploadRequest},
    Refusal,
};

/// How long an aggregator that does not answer is waited for.
pub const PATIENCE: Duration = Duration::from_secs(120);

/// How long one request may take; uploads and downloads may take longer.
const REQUEST_TIMEOUT: Duration = Duration::from_secs(60);

/// Bytes in one message of an upload.
const CHUNK_BYTES: usize = 64 << 10;

/// Checkpoints that are remembered, to notice a second history.
const REMEMBERED: usize = 4096;

/// A connection to the aggregator of one network.
pub struct Client {
    rpc: FederationClient<Channel>,
    network: Digest,
    genesis: Genesis,
    seen: Mutex<BTreeMap<u64, Digest>>,
}

/// A round, as the log has it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RoundView {
    /// How it opened.
    pub opened: RoundOpened,
    /// How it closed, if it has.
    pub closed: Option<RoundClosed>,
    /// The aggregator's clock, Unix milliseconds: deadlines are by that one.
    pub now_ms: u64,
}

/// A commitment on the log, and what follows from its place there.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Committed {
    /// What the update will be evaluated on, derived here from the receipt's checkpoint.
    pub challenge: Digest,
    /// That it is on the log.
    pub receipt: Receipt,
}

/// What became of a submission.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Decided {
    /// Why it does not count, as the log has it; `None` if it counts.
    pub rejected: Option<Refusal>,
    /// That the decision is on the log.
    pub receipt: Receipt,
}

/// Why a request brought nothing.
#[derive(Debug, thiserror::Error)]
pub enum ClientError {
    /// No address.
    #[error("'{address}' is not the address of an aggregator: {cause}")]
    Address { address: String, cause: String },
    /// The aggregator turned it down, or is away.
    #[error("{what}: {} ({})", status.message(), status.code())]
    Refused {
        what: &'static str,
        status: Box<Status>,
    },
    /// Another network.
    #[error("the aggregator runs network {found}, not {expected}")]
    OtherNetwork { found: Digest, expected: Digest },
    /// An answer that is none.
    #[error("the aggregator's answer to '{what}' makes no sense: {why}")]
    Malformed { what: &'static str, why: String },
    /// A checkpoint that the log's key has not signed.
    #[error("the aggregator's answer to '{what}' is not to be believed: {error}")]
    Checkpoint {
        what: &'static str,
        error: CheckpointError,
    },
    /// A receipt that proves nothing.
    #[error("the aggregator's answer to '{what}' is not to be believed: {error}")]
    Receipt {
        what: &'static str,
        error: ReceiptError,
    },
    /// A receipt for something else.
    #[error("the receipt for '{what}' is about another entry: {found}")]
    OtherEntry { what: &'static str, found: String },
    /// Two histories.
    #[error("the aggregator signed two histories: its first {size} entries have root {first} and root {second}; keep both checkpoints, they are evidence")]
    SplitView {
        size: u64,
        first: Digest,
        second: Digest,
    },
    /// A download that is not what was asked for.
    #[error("blob {blob}: {why}")]
    Blob { blob: Digest, why: String },
    /// Weights that are not what the log says.
    #[error("weights: {0}")]
    Weights(#[from] Refusal),
}

impl Client {
    /// Connects to the aggregator at `address` (`http://host:port`) and checks that it runs `network`: its genesis hashes to
    /// that, and its newest checkpoint is signed by the key in there.
    pub async fn connect(address: &str, network: &Digest) -> Result<Self, ClientError> {
        let endpoint =
            Endpoint::from_shared(address.to_owned()).map_err(|error| ClientError::Address {
                address: address.into(),
                cause: error.to_string(),
            })?;
        let rpc = FederationClient::new(endpoint.connect_timeout(REQUEST_TIMEOUT).connect_lazy());
        let what = "get network";
        let info = patiently(what, || {
            let mut rpc = rpc.clone();
            async move { rpc.get_network(limited(GetNetworkRequest {})).await }
        })
        .await?;
        let malformed = |why: String| ClientError::Malformed { what, why };
        let entry = Entry::decode(&info.genesis).map_err(|error| malformed(error.to_string()))?;
        let Body::Genesis(genesis) = entry.body else {
            return Err(malformed("its first entry is no genesis".into()));
        };
        let found = genesis.network_id();
        if found != *network {
            return Err(ClientError::OtherNetwork {
                found,
                expected: *network,
            });
        }
        let client = Self {
            rpc,
            network: found,
            genesis,
            seen: Mutex::default(),
        };
        let (origin, key) = (client.genesis.origin(), &client.genesis.log_key);
        let checkpoint = Checkpoint::open(info.checkpoint.as_bytes(), origin, key)
            .map_err(|error| ClientError::Checkpoint { what, error })?;
        client.remember(&checkpoint)?;
        Ok(client)
    }

    /// The network's id.
    pub fn network(&self) -> &Digest {
        &self.network
    }

    /// The founding document.
    pub fn genesis(&self) -> &Genesis {
        &self.genesis
    }

    /// A round, or the last one that was opened; `None` if there is none yet.
    pub async fn round(&self, round: Option<u64>) -> Result<Option<RoundView>, ClientError> {
        let what = "get round";
        let info = patiently(what, || {
            let mut rpc = self.rpc.clone();
            async move { rpc.get_round(limited(GetRoundRequest { round })).await }
        })
        .await?;
        let Some(opened) = info.opened else {
            return Ok(None);
        };
        let (_, entry, _) = self.check(what, opened)?;
        let opened = match entry.body {
            Body::RoundOpened(opened) if round.is_none_or(|asked| asked == opened.round) => opened,
            other => return Err(other_entry(what, &other)),
        };
        let closed = match info.closed {
            None => None,
            Some(closed) => match self.check(what, closed)?.1.body {
                Body::RoundClosed(closed) if closed.round == opened.round => Some(closed),
                other => return Err(other_entry(what, &other)),
            },
        };
        Ok(Some(RoundView {
            opened,
            closed,
            now_ms: info.now_ms,
        }))
    }

    /// A public blob of at most `limit` bytes. It is what its name says, or an error.
    pub async fn download(&self, blob: &Digest, limit: u64) -> Result<Vec<u8>, ClientError> {
        let what = "download";
        let refuse = |why: String| ClientError::Blob { blob: *blob, why };
        let mut stream = patiently(what, || {
            let mut rpc = self.rpc.clone();
            let blob = blob.0.to_vec();
            async move { rpc.download(DownloadRequest { blob }).await }
        })
        .await?;
        let (mut bytes, mut hasher) = (Vec::new(), Sha256::new());
        while let Some(chunk) = stream
            .message()
            .await
            .map_err(|status| refused(what, status))?
        {
            if (bytes.len() + chunk.data.len()) as u64 > limit {
                return Err(refuse(format!("more than {limit} bytes came")));
            }
            hasher.update(&chunk.data);
            bytes.extend_from_slice(&chunk.data);
        }
        let actual = Digest(hasher.finalize().into());
        match actual == *blob {
            true => Ok(bytes),
            false => Err(refuse(format!("what came has SHA-256 {actual}"))),
        }
    }

    /// Puts a dataset commitment on the log, with the list of its leaves.
    pub async fn register(
        &self,
        registration: &Signed<DatasetRegistration>,
        leaves: &[Digest],
    ) -> Result<Receipt, ClientError> {
        let what = "register dataset";
        let request = RegisterDatasetRequest {
            registration: encode(what, registration)?,
            leaves: leaves.iter().flat_map(|leaf| leaf.0).collect(),
        };
        let receipt = patiently(what, || {
            let (mut rpc, request) = (self.rpc.clone(), request.clone());
            async move { rpc.register_dataset(limited(request)).await }
        })
        .await?;
        match self.check(what, receipt)? {
            (
                receipt,
                Entry {
                    body: Body::DatasetCommitted(found),
                    ..
                },
                _,
            ) if found == *registration => Ok(receipt),
            (_, entry, _) => Err(other_entry(what, &entry.body)),
        }
    }

    /// Uploads an update; nobody can read it before the round has closed.
    pub async fn upload(
        &self,
        request: &Signed<UploadRequest>,
        bytes: &[u8],
    ) -> Result<(), ClientError> {
        let what = "upload";
        let first = Part::Request(encode(what, request)?);
        let data = bytes
            .chunks(CHUNK_BYTES)
            .map(|data| Part::Data(data.to_vec()));
        let parts: Vec<_> = std::iter::once(first)
            .chain(data)
            .map(|part| UploadChunk { part: Some(part) })
            .collect();
        patiently(what, || {
            let mut rpc = self.rpc.clone();
            let parts = tokio_stream::iter(parts.clone());
            async move { rpc.upload(parts).await }
        })
        .await?;
        Ok(())
    }

    /// Commits to an uploaded update, and derives the challenge.
    pub async fn commit(
        &self,
        commitment: &Signed<UpdateCommitment>,
    ) -> Result<Committed, ClientError> {
        let what = "commit";
        let request = CommitRequest {
            commitment: encode(what, commitment)?,
        };
        let receipt = patiently(what, || {
            let (mut rpc, request) = (self.rpc.clone(), request.clone());
            async move { rpc.commit(limited(request)).await }
        })
        .await?;
        let (receipt, entry, checkpoint) = self.check(what, receipt)?;
        match entry.body {
            Body::UpdateCommitted(found) if found == *commitment => {}
            other => return Err(other_entry(what, &other)),
        }
        if Some(checkpoint.size) != receipt.index.checked_add(1) {
            return Err(ClientError::Malformed {
                what,
                why: format!(
                    "entry {}'s challenge follows from the checkpoint right after it, not from that of size {}",
                    receipt.index, checkpoint.size
                ),
            });
        }
        let UpdateCommitment { round, node, .. } = commitment.statement;
        Ok(Committed {
            challenge: challenge(&self.network, round, &node, receipt.index, &checkpoint.root),
            receipt,
        })
    }

    /// Submits a claim with its proof.
    pub async fn submit(
        &self,
        submission: &Signed<Submission>,
        proof: &[u8],
    ) -> Result<Decided, ClientError> {
        let what = "submit";
        let request = SubmitRequest {
            submission: encode(what, submission)?,
            proof: proof.to_vec(),
        };
        let reply = patiently(what, || {
            let (mut rpc, request) = (self.rpc.clone(), request.clone());
            async move { rpc.submit(limited(request)).await }
        })
        .await?;
        let receipt = reply.receipt.ok_or_else(|| ClientError::Malformed {
            what,
            why: "there is no receipt".into(),
        })?;
        let (receipt, entry, _) = self.check(what, receipt)?;
        let rejected = match entry.body {
            Body::ContributionAccepted(found) if found == *submission => None,
            Body::ContributionRejected {
                submission: found,
                reason,
            } if found == *submission => Some(reason),
            other => return Err(other_entry(what, &other)),
        };
        match reply.accepted == rejected.is_none() {
            true => Ok(Decided { rejected, receipt }),
            false => Err(ClientError::Malformed {
                what,
                why: "it says other than the log".into(),
            }),
        }
    }

    /// Checks a receipt to the last byte.
    fn check(
        &self,
        what: &'static str,
        receipt: rpc::Receipt,
    ) -> Result<(Receipt, Entry, Checkpoint), ClientError> {
        let proof = receipt.inclusion.iter().map(|hash| {
            let hash: [u8; 32] = hash.as_slice().try_into().ok()?;
            Some(Digest(hash))
        });
        let receipt = Receipt {
            index: receipt.index,
            entry: receipt.entry,
            checkpoint: receipt.checkpoint.into_bytes(),
            proof: proof.collect::<Option<_>>().ok_or(ClientError::Malformed {
                what,
                why: "an inclusion proof consists of hashes of 32 bytes".into(),
            })?,
        };
        let (checkpoint, entry) = receipt
            .verify(&self.genesis.log_key, self.genesis.origin())
            .map_err(|error| ClientError::Receipt { what, error })?;
        self.remember(&checkpoint)?;
        Ok((receipt, entry, checkpoint))
    }

    /// Two roots for one size are two histories.
    fn remember(&self, checkpoint: &Checkpoint) -> Result<(), ClientError> {
        let mut seen = self.seen.lock().unwrap_or_else(PoisonError::into_inner);
        let first = *seen.entry(checkpoint.size).or_insert(checkpoint.root);
        if first != checkpoint.root {
            return Err(ClientError::SplitView {
                size: checkpoint.size,
                first,
                second: checkpoint.root,
            });
        }
        if seen.len() > REMEMBERED {
            seen.pop_first();
        }
        Ok(())
    }
}

fn limited<T>(message: T) -> tonic::Request<T> {
    let mut request = tonic::Request::new(message);
    request.set_timeout(REQUEST_TIMEOUT);
    request
}

/// Asks until there is an answer, for [`PATIENCE`] while nobody is there to give one.
async fn patiently<T, F>(what: &'static str, ask: impl Fn() -> F) -> Result<T, ClientError>
where
    F: Future<Output = Result<tonic::Response<T>, Status>>,
{
    let until = Instant::now() + PATIENCE;
    let mut pause = Duration::from_millis(100);
    loop {
        match ask().await {
            Ok(answer) => return Ok(answer.into_inner()),
            Err(status) if is_away(&status) && Instant::now() + pause < until => {
                tracing::debug!(what, %status, "the aggregator is away, asking again");
            }
            Err(status) => return Err(refused(what, status)),
        }
        sleep(pause).await;
        pause = (pause * 2).min(Duration::from_secs(5));
    }
}

/// Nobody is there, or they went away in the middle.
fn is_away(status: &Status) -> bool {
    status.code() == Code::Unavailable
        || (status.code() == Code::Unknown && status.message().contains("transport error"))
}

fn refused(what: &'static str, status: Status) -> ClientError {
    ClientError::Refused {
        what,
        status: Box::new(status),
    }
}

fn encode<T: borsh::BorshSerialize>(what: &'static str, value: &T) -> Result<Vec<u8>, ClientError> {
    borsh::to_vec(value).map_err(|error| ClientError::Malformed {
        what,
        why: error.to_string(),
    })
}

fn other_entry(what: &'static str, found: &Body) -> ClientError {
    ClientError::OtherEntry {
        what,
        found: format!("{found:?}").chars().take(300).collect(),
    }
}
