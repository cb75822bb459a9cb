//! Following a round: the aggregator tells the node when a round has come further, and the node asks again when the connection is lost.

use crate::client::{is_lost, Node, APART, ATTEMPTS};
use crate::client_error::NodeError;
use tonic::Streaming;
use zk0_protocol::rpc::federation as rpc;

/// A round that the node follows, or whichever is the last one.
pub(crate) struct Watch {
    request: rpc::GetRoundRequest,
    stream: Option<Streaming<rpc::RoundInfo>>,
    failed: u32,
}

impl Watch {
    /// Follows `round`, or the last round, for the node `node` if it wants to know whether it may contribute.
    pub fn of(round: Option<u64>, node: Vec<u8>) -> Self {
        Self {
            request: rpc::GetRoundRequest { round, node },
            stream: None,
            failed: 0,
        }
    }
}

impl Node {
    /// Waits until the round of `watch` has come further, and returns how far. The first call returns at once.
    pub(crate) async fn next_stage(
        &mut self,
        watch: &mut Watch,
    ) -> Result<rpc::RoundInfo, NodeError> {
        loop {
            let told = match &mut watch.stream {
                Some(stream) => stream.message().await,
                None => match self.client.watch_round(watch.request.clone()).await {
                    Ok(stream) => {
                        watch.stream = Some(stream.into_inner());
                        continue;
                    }
                    Err(status) => Err(status),
                },
            };
            match told {
                Ok(Some(info)) => {
                    watch.failed = 0;
                    return Ok(info);
                }
                // The aggregator ends the stream after some minutes.
                Ok(None) => {}
                Err(status) if is_lost(&status) && watch.failed < ATTEMPTS => {
                    if watch.failed == 0 {
                        tracing::warn!(
                            "the connection to the aggregator is lost ({}); the node asks again every two seconds",
                            status.message()
                        );
                    }
                    watch.failed += 1;
                }
                Err(status) => return Err(status.into()),
            }
            watch.stream = None;
            tokio::time::sleep(APART).await;
        }
    }
}
