//! Uploads. After a lost connection, the node goes on where it was cut.

use crate::connections::caller::Sender;
use crate::round::intake::staging::Staging;
use crate::round::request_error::RequestError;
use crate::serve::limits::Limits;
use crate::serve::senders::sender::read_hashed;
use crate::serve::service::{blocking, Service};
use crate::serve::uploads::Newest;
use std::time::Duration;
use tokio::sync::{OwnedMutexGuard, OwnedSemaphorePermit};
use tokio::task::JoinSet;
use tokio::time::{timeout_at, Instant};
use tonic::{Status, Streaming};
use tracing::info_span;
use zk0_ledger::blobs::partial::PartialBlob;
use zk0_protocol::entries::signed::{Submission, UploadRequest};
use zk0_protocol::request_head::{Method, RequestContent};
use zk0_protocol::rpc::federation::upload_chunk::Part;
use zk0_protocol::rpc::federation::{UploadChunk, UploadInfo};

const BATCH_BYTES: usize = 256 << 10;

/// The node's next upload waits until this is dropped.
struct Writing {
    blob: PartialBlob,
    _turn: OwnedMutexGuard<()>,
}

impl Service {
    /// Receives an upload. After a lost connection, it still writes what has come.
    pub(super) async fn uploaded(
        &self,
        sender: Sender,
        stream: Streaming<UploadChunk>,
    ) -> Result<(), Status> {
        let mut incoming = Incoming {
            stream,
            limits: self.limits,
            ends: Instant::now() + self.limits.upload,
        };
        let (begins, first, stored) = match incoming.next().await? {
            Some((begins, Part::Request(first))) => (begins, first, false),
            Some((_, Part::Stored(first))) => (0, first, true),
            _ => {
                return Err(malformed(
                    "the first message of an upload holds its signed request",
                ))
            }
        };
        let (signed, body) = read_hashed::<UploadRequest>("upload request", first).await?;
        let upload = signed.statement.clone();
        let message = RequestContent {
            method: Method::Upload,
            round: Some(upload.round),
            signer: upload.node,
            body,
        };
        sender.sends(&message)?;
        let _place = self.transfer(true)?;
        let Some(staging) = self.begun(upload.clone()).await? else {
            return Ok(());
        };
        let newest = self.uploads.begin(upload.node);
        let uploads = staging.of(upload.round, &upload.node);
        if stored {
            if incoming.next().await?.is_some() {
                return Err(malformed(
                    "nothing follows the request of an update that is in the store",
                ));
            }
            let ends = incoming.ends;
            self.take_stored(ends, newest, staging, upload.clone())
                .await?;
        } else {
            self.receive_data(incoming, newest, staging, upload.clone(), begins)
                .await?;
        }
        // The next commitment takes it.
        let lost = self.with(move |aggregator| Ok(aggregator.lost_update(&upload)));
        if let Some(lost) = lost.await? {
            let take = move || lost.take(&uploads);
            self.storing(info_span!("keep blobs"), take).await?;
        }
        Ok(())
    }

    pub(super) async fn take_lost_proof(
        &self,
        submission: &Submission,
        proof: Vec<u8>,
    ) -> Result<(), RequestError> {
        let submission = submission.clone();
        let lost = self.with(move |aggregator| Ok(aggregator.lost_proof(&submission)));
        if let Some(lost) = lost.await? {
            let put = move || lost.put(&proof);
            self.storing(info_span!("keep blobs"), put).await?;
        }
        Ok(())
    }

    pub(super) fn transfer(&self, of_node: bool) -> Result<OwnedSemaphorePermit, RequestError> {
        let crowded = "too many files are sent and received at once: ask again later";
        let place = self.transfers.begin(of_node);
        place.ok_or_else(|| RequestError::Crowded(crowded.into()))
    }

    /// How many bytes of an upload are here, and where else the node may put the update.
    pub(super) async fn held(&self, request: Vec<u8>) -> Result<UploadInfo, RequestError> {
        let (signed, _) = read_hashed::<UploadRequest>("upload request", request).await?;
        let upload = signed.statement.clone();
        let Some(staging) = self.begun(upload.clone()).await? else {
            return Ok(UploadInfo {
                held: upload.size,
                address: String::new(),
            });
        };
        let request = upload.clone();
        let (held, begins) =
            blocking(move || Ok((staging.held(&request)?, staging.begins(&request)?))).await?;
        let address = if begins {
            self.upload_address(&upload).await
        } else {
            None
        };
        Ok(UploadInfo {
            held,
            address: address.unwrap_or_default(),
        })
    }

    async fn begun(&self, request: UploadRequest) -> Result<Option<Staging>, RequestError> {
        self.with(move |aggregator| aggregator.begin_upload(&request))
            .await
    }

    /// Waits until the ledger no longer allows an upload, and returns why.
    pub(super) async fn not_allowed(&self, upload: &UploadRequest) -> RequestError {
        let mut stage = self.stage.subscribe();
        loop {
            if let Err(refused) = self.begun(upload.clone()).await {
                return refused;
            }
            if stage.changed().await.is_err() {
                return std::future::pending().await;
            }
        }
    }

    /// Why an upload has failed. The end of its round removes its files; the node then learns that, and not that a file is gone.
    pub(super) async fn why(&self, upload: &UploadRequest, error: RequestError) -> RequestError {
        self.begun(upload.clone()).await.err().unwrap_or(error)
    }

    async fn receive_data(
        &self,
        mut incoming: Incoming,
        newest: Newest,
        staging: Staging,
        upload: UploadRequest,
        begins: u64,
    ) -> Result<(), Status> {
        let turn = newest.turn().await;
        let request = upload.clone();
        let blob = blocking(move || Ok(staging.go_on(&request, begins)?)).await?;
        let Some(blob) = blob else {
            return Ok(());
        };
        let mut writing = Writing { blob, _turn: turn };
        let mut ended = false;
        // A task of its own: a future that is not polled while a batch is written could hold the aggregator.
        let mut watching = JoinSet::new();
        let (service, watched) = (self.clone(), upload.clone());
        watching.spawn(async move { service.not_allowed(&watched).await });
        while !ended {
            let mut batch = vec![];
            let mut failed = None;
            while batch.len() < BATCH_BYTES && !ended && failed.is_none() {
                let next = tokio::select! {
                    next = incoming.next() => next,
                    ended = newest.ended() => Err(ended.into()),
                    Some(Ok(refused)) = watching.join_next() => Err(refused.into()),
                };
                match next {
                    Ok(Some((_, Part::Data(data)))) => batch.extend(data),
                    Ok(Some(_)) => {
                        let why = "an upload holds one request, and nothing but data after it";
                        failed = Some(malformed(why));
                    }
                    Ok(None) => ended = true,
                    Err(status) => failed = Some(status),
                }
            }
            // What has come stays, whatever follows.
            let written = blocking(move || {
                writing.blob.write(&batch).map_err(RequestError::upload)?;
                Ok(writing)
            });
            writing = match written.await {
                Ok(writing) => writing,
                Err(error) => return Err(self.why(&upload, error).await.into()),
            };
            if let Some(status) = failed {
                return Err(status);
            }
        }
        let finished = blocking(move || writing.blob.finish().map_err(RequestError::upload));
        if let Err(error) = finished.await {
            return Err(self.why(&upload, error).await.into());
        }
        self.metrics().uploaded("message");
        tracing::info!(node = %upload.node, update = %upload.blob, size = upload.size, begins, "update uploaded");
        Ok(())
    }
}

struct Incoming {
    stream: Streaming<UploadChunk>,
    limits: Limits,
    ends: Instant,
}

impl Incoming {
    /// The next part, and where its data begins. An error if the part or the upload takes too long.
    async fn next(&mut self) -> Result<Option<(u64, Part)>, Status> {
        let Limits {
            silence, upload, ..
        } = self.limits;
        let silent = Instant::now() + silence;
        let message = timeout_at(silent.min(self.ends), self.stream.message());
        let message = message.await.map_err(|_| {
            if self.ends < silent {
                too_long("the upload took", upload)
            } else {
                too_long("no data came for", silence)
            }
        })??;
        match message {
            None => Ok(None),
            Some(UploadChunk {
                part: Some(part),
                begins,
            }) => Ok(Some((begins, part))),
            Some(UploadChunk { part: None, .. }) => {
                Err(malformed("a message of the upload is empty"))
            }
        }
    }
}

fn malformed(what: &str) -> Status {
    RequestError::Malformed(what.into()).into()
}

pub(super) fn too_long(what: &str, limit: Duration) -> Status {
    RequestError::TimedOut(format!("{what} more than {} ms", limit.as_millis())).into()
}
