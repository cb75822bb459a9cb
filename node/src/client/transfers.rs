//! Uploads and downloads, which go on after an interruption.

use crate::client::heads::About;
use crate::client::waits::Waits;
use crate::client::{encode, NodeClient};
use crate::client_error::NodeError;
use crate::observe::AskedService;
use sha2::{Digest as _, Sha256};
use std::io::Write;
use std::sync::Arc;
use tokio::task::spawn_blocking;
use tonic::{Code, Status};
use tracing::instrument;
use zk0_circuits::Digest;
use zk0_protocol::entries::signed::{Signed, UploadRequest};
use zk0_protocol::request_head::Method;
use zk0_protocol::rpc::federation as rpc;
use zk0_protocol::rpc::federation::upload_chunk::Part;

/// Bytes in one message of an upload. The aggregator reserves memory for messages over 32 KiB.
const CHUNK_BYTES: usize = 16 << 10;

/// The attempts of a transfer. Progress begins the waits again.
struct Attempts {
    what: &'static str,
    furthest: u64,
    waits: Waits,
}

impl Attempts {
    fn of(what: &'static str) -> Self {
        Self {
            what,
            furthest: 0,
            waits: Waits::default(),
        }
    }

    async fn again(
        &mut self,
        node: &mut NodeClient,
        failure: Status,
        begins: u64,
    ) -> Result<(), NodeError> {
        if begins > self.furthest {
            self.furthest = begins;
            self.waits.end();
            let what = self.what;
            tracing::info!("the {what} was cut after {begins} bytes; it goes on there");
        }
        node.again(&mut self.waits, failure).await
    }
}

impl NodeClient {
    /// Downloads a public blob of at most `limit` bytes.
    pub async fn download(&mut self, blob: &Digest, limit: u64) -> Result<Vec<u8>, NodeError> {
        let mut bytes = Vec::new();
        self.download_to(blob, limit, &mut bytes).await?;
        Ok(bytes)
    }

    /// Writes a public blob to `out` piece by piece. It is whole only if this returns without an error.
    #[instrument(name = "download", skip_all)]
    pub async fn download_to(
        &mut self,
        blob: &Digest,
        limit: u64,
        out: &mut (impl Write + Send),
    ) -> Result<(), NodeError> {
        let (mut hash, mut held) = (Sha256::new(), 0);
        let mut attempts = Attempts::of("download");
        loop {
            let part = self.download_part(blob, limit, &mut hash, &mut held, out);
            match part.await {
                Ok(()) => break,
                Err(NodeError::Refused(failure)) => attempts.again(self, *failure, held).await?,
                Err(error) => return Err(error),
            }
        }
        attempts.waits.end();
        self.metrics.answered(AskedService::Aggregator);
        out.flush().map_err(NodeError::Write)?;
        match Digest(hash.finalize().into()) {
            actual if actual == *blob => Ok(()),
            actual => Err(NodeError::OtherBlob {
                asked: *blob,
                actual,
            }),
        }
    }

    /// Downloads what follows the first `held` bytes, until the end or a lost connection.
    async fn download_part(
        &mut self,
        blob: &Digest,
        limit: u64,
        hash: &mut Sha256,
        held: &mut u64,
        out: &mut (impl Write + Send),
    ) -> Result<(), NodeError> {
        let about = About::message(Method::Download, &blob.0);
        let request = rpc::DownloadRequest {
            blob: blob.0.to_vec(),
            begins: *held,
        };
        let request = self.headed(&about, request)?;
        let mut chunks = self.client.download(request).await?.into_inner();
        while let Some(chunk) = chunks.message().await? {
            let more = *held + chunk.data.len() as u64;
            if more > limit {
                return Err(NodeError::TooLarge { blob: *blob, limit });
            }
            hash.update(&chunk.data);
            out.write_all(&chunk.data).map_err(NodeError::Write)?;
            *held = more;
        }
        Ok(())
    }

    /// Uploads an update, from the byte where the aggregator's copy ends. It stays private until the round closes.
    #[instrument(name = "upload", skip_all)]
    pub async fn upload(&mut self, round: u64, update: Vec<u8>) -> Result<(), NodeError> {
        // An update of the published size has hundreds of megabytes.
        let update = Arc::new(update);
        let request = UploadRequest {
            network: self.heads.network,
            round,
            node: self.id(),
            blob: Digest(Sha256::digest(&*update).into()),
            size: update.len() as u64,
        };
        let signed = encode(&Signed::new(request, &self.key));
        let about = About::message(Method::Upload, &signed).in_round(round);
        let mut attempts = Attempts::of("upload");
        // The store is tried once; an upload begins again once.
        let (mut held, mut stored, mut begun_again) = (0, false, false);
        loop {
            let part = self.upload_part(&about, &signed, &update, &mut held, &mut stored);
            match part.await {
                Ok(()) => break,
                // The aggregator's part was damaged, and is removed.
                Err(NodeError::Refused(status))
                    if held > 0 && status.code() == Code::InvalidArgument && !begun_again =>
                {
                    tracing::warn!("the upload begins again: {status}");
                    begun_again = true;
                }
                Err(NodeError::Refused(failure)) => attempts.again(self, *failure, held).await?,
                Err(error) => return Err(error),
            }
        }
        attempts.waits.end();
        self.metrics.answered(AskedService::Aggregator);
        Ok(())
    }

    /// Sends the bytes that the aggregator lacks. If it has none and gives an address, the update goes there, unless that was tried before
    /// (`stored`).
    async fn upload_part(
        &mut self,
        about: &About,
        signed: &[u8],
        update: &Arc<Vec<u8>>,
        held: &mut u64,
        stored: &mut bool,
    ) -> Result<(), NodeError> {
        let request = rpc::GetUploadRequest {
            request: signed.to_vec(),
        };
        let info = self.client.get_upload(request.clone()).await?.into_inner();
        *held = info.held;
        if *held == 0 && !info.address.is_empty() && !*stored {
            *stored = true;
            match self.store_update(about, signed, update, info.address).await {
                Ok(()) => return Ok(()),
                Err(why) => tracing::warn!("the update goes through the aggregator: {why}"),
            }
            *held = self.client.get_upload(request).await?.into_inner().held;
        }
        let first = rpc::UploadChunk {
            part: Some(Part::Request(signed.to_vec())),
            begins: *held,
        };
        let update = update.clone();
        let rest = (*held as usize..update.len()).step_by(CHUNK_BYTES);
        let rest = rest.map(move |at| rpc::UploadChunk {
            part: Some(Part::Data(
                update[at..update.len().min(at + CHUNK_BYTES)].to_vec(),
            )),
            begins: 0,
        });
        let parts = tokio_stream::iter(std::iter::once(first).chain(rest));
        self.client.upload(self.headed(about, parts)?).await?;
        Ok(())
    }

    async fn store_update(
        &mut self,
        about: &About,
        signed: &[u8],
        update: &Arc<Vec<u8>>,
        address: String,
    ) -> Result<(), NodeError> {
        let (store, sent) = (self.store.clone(), update.clone());
        let putting = spawn_blocking(move || store.put(&address, &sent));
        match putting.await {
            Ok(put) => put.map_err(|error| NodeError::Store(error.to_string()))?,
            Err(error) => return Err(NodeError::Store(error.to_string())),
        }
        let first = rpc::UploadChunk {
            part: Some(Part::Stored(signed.to_vec())),
            begins: 0,
        };
        let parts = tokio_stream::once(first);
        self.client.upload(self.headed(about, parts)?).await?;
        tracing::info!(
            bytes = update.len(),
            "the update went straight to the aggregator's store"
        );
        Ok(())
    }
}
