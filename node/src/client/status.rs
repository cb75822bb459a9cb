//! How an aggregator is doing. Only the checkpoint is signed. No decision uses the rest.

use crate::client::watching::FollowedRound;
use crate::client::NodeClient;
use crate::client_error::NodeError;
use zk0_protocol::rpc::federation as rpc;
use zk0_protocol::tlog::checkpoint::Checkpoint;

/// Follows the last round.
pub struct RoundWatch(FollowedRound);

impl Default for RoundWatch {
    fn default() -> Self {
        Self(FollowedRound::of(None, Vec::new()))
    }
}

impl NodeClient {
    /// How the aggregator is doing.
    pub async fn status(&mut self) -> Result<rpc::StatusInfo, NodeError> {
        let status = self.client.get_status(rpc::GetStatusRequest {}).await;
        Ok(status?.into_inner())
    }

    /// The newest published checkpoint, with the log's signature verified.
    pub async fn checkpoint(&mut self) -> Result<Checkpoint, NodeError> {
        Ok(self.signed_checkpoint().await?.0)
    }

    /// The same, with the note that the log has signed.
    pub async fn signed_checkpoint(&mut self) -> Result<(Checkpoint, String), NodeError> {
        let info = self.client.get_network(rpc::GetNetworkRequest {}).await;
        let note = info?.into_inner().checkpoint;
        Ok((self.open_checkpoint(note.as_bytes())?, note))
    }

    /// Waits until the last round has come further. The first call returns at once.
    pub async fn changed(&mut self, watch: &mut RoundWatch) -> Result<(), NodeError> {
        self.next_stage(&mut watch.0).await.map(drop)
    }
}
