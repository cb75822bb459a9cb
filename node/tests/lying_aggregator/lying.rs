//! The aggregator that lies.

use super::Failures;
use std::pin::Pin;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::Arc;
use tokio_stream::{Stream, StreamExt};
use tonic::{Request, Response, Status, Streaming};
use zk0_protocol::rpc::federation as rpc;
use zk0_protocol::rpc::federation::federation_server::Federation;

/// An aggregator that shows whatever a test makes up.
pub struct Lying {
    pub genesis: Vec<u8>,
    pub checkpoint: String,
    pub round: rpc::RoundInfo,
    /// What it names as the program in force, if not the round's.
    pub in_force: Option<Vec<u8>>,
    /// Counts the nodes that follow the round.
    pub follows: Arc<AtomicUsize>,
    pub governance: rpc::GovernanceInfo,
    pub failures: Failures,
    pub protocol: u32,
}

type Answer<T> = Result<Response<T>, Status>;

/// What the tests never ask for.
fn not_asked<T>() -> Answer<T> {
    Err(Status::unimplemented("no test asks for this"))
}

#[tonic::async_trait]
impl Federation for Lying {
    async fn get_network(&self, _: Request<rpc::GetNetworkRequest>) -> Answer<rpc::NetworkInfo> {
        Ok(Response::new(rpc::NetworkInfo {
            run: vec![7; 16],
            genesis: self.genesis.clone(),
            checkpoint: self.checkpoint.clone(),
            protocol: self.protocol,
            release: "it is zk0 9.0".into(),
        }))
    }

    async fn get_round(&self, _: Request<rpc::GetRoundRequest>) -> Answer<rpc::RoundInfo> {
        let mut round = self.round.clone();
        if let Some(program) = &self.in_force {
            round.program = program.clone();
        }
        Ok(Response::new(round))
    }

    type WatchRoundStream = Pin<Box<dyn Stream<Item = Result<rpc::RoundInfo, Status>> + Send>>;

    async fn watch_round(
        &self,
        _: Request<rpc::GetRoundRequest>,
    ) -> Answer<Self::WatchRoundStream> {
        self.fail()?;
        self.follows.fetch_add(1, Ordering::Relaxed);
        let told = tokio_stream::once(Ok(self.round.clone()));
        Ok(Response::new(Box::pin(told.chain(tokio_stream::pending()))))
    }

    async fn get_status(&self, _: Request<rpc::GetStatusRequest>) -> Answer<rpc::StatusInfo> {
        not_asked()
    }

    type DownloadStream = Pin<Box<dyn Stream<Item = Result<rpc::Chunk, Status>> + Send>>;

    /// Sends far more than weights have.
    async fn download(&self, _: Request<rpc::DownloadRequest>) -> Answer<Self::DownloadStream> {
        let data = vec![0; 64 << 10];
        let chunks = std::iter::repeat_n(rpc::Chunk { data }, 256);
        let chunks = tokio_stream::iter(chunks.map(Ok::<_, Status>));
        Ok(Response::new(Box::pin(chunks)))
    }

    async fn upload(&self, _: Request<Streaming<rpc::UploadChunk>>) -> Answer<rpc::UploadReply> {
        not_asked()
    }

    async fn get_upload(&self, _: Request<rpc::GetUploadRequest>) -> Answer<rpc::UploadInfo> {
        not_asked()
    }

    async fn submit(&self, _: Request<rpc::SubmitRequest>) -> Answer<rpc::SubmitReply> {
        not_asked()
    }

    async fn record(&self, _: Request<rpc::RecordRequest>) -> Answer<rpc::Receipt> {
        not_asked()
    }

    async fn get_governance(
        &self,
        _: Request<rpc::GetGovernanceRequest>,
    ) -> Answer<rpc::GovernanceInfo> {
        self.fail()?;
        Ok(Response::new(self.governance.clone()))
    }
}

impl Lying {
    fn fail(&self) -> Result<(), Status> {
        self.failures.lock().unwrap().pop().map_or(Ok(()), Err)
    }
}
