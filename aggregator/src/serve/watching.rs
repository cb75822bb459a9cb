//! Nodes that follow a round are told of its progress, so that they need not ask again and again.

use crate::round::presence::Following;
use crate::round::request_error::RequestError;
use crate::serve::federation_service::encode;
use crate::serve::service::{blocking, Service};
use tokio::sync::mpsc;
use tokio::time::{sleep, timeout};
use tokio_stream::wrappers::ReceiverStream;
use tonic::Status;
use zk0_circuits::NodeId;
use zk0_protocol::rpc::federation::RoundInfo;
use zk0_protocol::rules::state::Round;

impl Service {
    pub(super) async fn note_stage(&self) -> Result<(), RequestError> {
        let service = self.clone();
        let stage = self.with(move |aggregator| match service.visible(aggregator) {
            Ok(published) => Ok(aggregator.round(None, published)),
            Err(_) => Ok(None),
        });
        let stage = stage.await?;
        self.stage.send_if_modified(|told| {
            let changed = *told != stage;
            *told = stage;
            changed
        });
        Ok(())
    }

    /// A round, or the last one, as far as it has come.
    pub(super) async fn round_info(
        &self,
        round: Option<u64>,
        node: Option<NodeId>,
    ) -> Result<RoundInfo, RequestError> {
        let service = self.clone();
        let seen = self.with(move |aggregator| {
            let (state, published) = (aggregator.state(), service.visible(aggregator)?);
            let contribution = round
                .zip(node)
                .and_then(|(round, node)| aggregator.contribution(round, &node, published));
            let asked = |open: &&Round| round.is_none_or(|round| round == open.number());
            let open = state.round().filter(asked).zip(node);
            let contributed = open.map(|(open, node)| aggregator.contributed(open, node));
            let info = RoundInfo {
                moved_ms: state.round().filter(asked).map_or(0, |open| open.moved_ms),
                invited: open.is_some_and(|(open, node)| state.may_contribute(open, &node)),
                now_ms: aggregator.now_ms(),
                program: encode(state.program())?,
                ..RoundInfo::default()
            };
            let entries = aggregator.round(round, published);
            let lost_from = (contributed, aggregator.ledger().blobs().clone());
            Ok((info, entries, contribution, lost_from, published))
        });
        let (info, entries, contribution, (contributed, blobs), published) = seen.await?;
        let Some(entries) = entries else {
            return Ok(info);
        };
        let ledger = self.ledger.clone();
        blocking(move || {
            let receipt = |index: Option<u64>| {
                let receipt = index.map(|index| ledger.receipt_at(published, index));
                Ok::<_, RequestError>(receipt.transpose()?.map(Into::into))
            };
            // Its checkpoint ends with the entry, as a node needs it to verify cosignatures of the closing.
            let closing = entries.commitments_closed;
            let closing = closing.map(|index| ledger.first_receipt(index));
            let lost = contributed.and_then(|contributed| contributed.lost(&blobs));
            let lost = lost.into_iter().flat_map(|lost| lost.files);
            let lost = lost.map(|file| file.0.to_vec());
            Ok(RoundInfo {
                lost: lost.collect(),
                opened: receipt(Some(entries.opened))?,
                commitments_closed: closing.transpose()?.map(Into::into),
                randomness: receipt(entries.randomness)?,
                closed: receipt(entries.closed)?,
                contribution: receipt(contribution)?,
                ..info
            })
        })
        .await
    }

    /// A round, or the last one, now and at each change, until the service ends, and for [`Limits::watch`] at most. The node is `present`
    /// for as long.
    ///
    /// [`Limits::watch`]: crate::serve::limits::Limits::watch
    pub(super) fn watched_round(
        &self,
        round: Option<u64>,
        node: Option<NodeId>,
        present: Option<Following>,
    ) -> ReceiverStream<Result<RoundInfo, Status>> {
        let (sender, told) = mpsc::channel(1);
        let service = self.clone();
        tokio::spawn(async move {
            let following = service.follow(round, node, &sender);
            tokio::select! {
                () = following => {}
                () = sleep(service.limits.watch) => {}
                () = sender.closed() => {}
                () = service.ended() => {}
            }
            drop(present);
        });
        ReceiverStream::new(told)
    }

    async fn follow(
        &self,
        round: Option<u64>,
        node: Option<NodeId>,
        sender: &mpsc::Sender<Result<RoundInfo, Status>>,
    ) {
        let mut stage = self.stage.subscribe();
        let mut told = None;
        loop {
            stage.borrow_and_update();
            let info = match self.round_info(round, node).await {
                // There is nothing to show yet.
                Err(RequestError::NotPublished(_)) => None,
                info => Some(info),
            };
            if let Some(info) = info {
                let failed = info.is_err();
                let news = info.as_ref().ok().map(news);
                if failed || news != told {
                    told = news;
                    let sent = sender.send(info.map_err(Into::into));
                    let sent = timeout(self.limits.silence, sent).await;
                    if failed || !sent.is_ok_and(|sent| sent.is_ok()) {
                        return;
                    }
                }
            }
            if stage.changed().await.is_err() {
                return;
            }
        }
    }
}

/// What is new to a follower: an entry, that it may contribute, or that a file of its contribution is lost. The clock and newer receipts
/// are no news.
fn news(info: &RoundInfo) -> ([Option<u64>; 5], bool, Vec<Vec<u8>>) {
    let entries = [
        &info.opened,
        &info.commitments_closed,
        &info.randomness,
        &info.closed,
        &info.contribution,
    ];
    let indices = entries.map(|entry| entry.as_ref().map(|receipt| receipt.index));
    (indices, info.invited, info.lost.clone())
}
