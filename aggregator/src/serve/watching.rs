//! Nodes that follow a round. A node is told when the round has come further, so that it need not ask again and again.

use crate::round::aggregator::Aggregator;
use crate::round::presence::Following;
use crate::round::request_error::RequestError;
use crate::serve::federation_service::encode;
use crate::serve::service::Service;
use tokio::sync::mpsc;
use tokio::time::{sleep, timeout};
use tokio_stream::wrappers::ReceiverStream;
use tonic::Status;
use zk0_circuits::NodeId;
use zk0_protocol::rpc::federation::RoundInfo;

impl Service {
    /// Tells those who follow a round if it has come further.
    pub(super) async fn note_stage(&self) -> Result<(), RequestError> {
        let service = self.clone();
        let stage = self.with(move |aggregator| match service.visible(aggregator) {
            Ok(published) => Ok(aggregator.stage(published)),
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
    pub(super) fn round_info(
        &self,
        aggregator: &Aggregator,
        round: Option<u64>,
        node: Option<NodeId>,
    ) -> Result<RoundInfo, RequestError> {
        let receipts = aggregator.round(round, node, self.visible(aggregator)?)?;
        let state = aggregator.state();
        let shown = state
            .round()
            .filter(|open| round.is_none_or(|round| round == open.number()));
        let open = shown.zip(node);
        Ok(RoundInfo {
            invited: open.is_some_and(|(open, node)| state.may_contribute(open, &node)),
            opened: receipts.opened.map(Into::into),
            commitments_closed: receipts.commitments_closed.map(Into::into),
            randomness: receipts.randomness.map(Into::into),
            closed: receipts.closed.map(Into::into),
            contribution: receipts.contribution.map(Into::into),
            now_ms: aggregator.now_ms(),
            program: encode(state.program())?,
        })
    }

    /// A round, or the last one, now and whenever it has come further, until the service ends, and for [`Limits::watch`] at most. Whoever is
    /// `present` is so for as long.
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
            let service = self.clone();
            let info = self.with(move |aggregator| service.round_info(aggregator, round, node));
            let info = match info.await {
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

/// What a follower has not heard: an entry, or that it may contribute. The clock always moves on, and an entry has a newer receipt whenever the ledger
/// has grown, so these are no news.
fn news(info: &RoundInfo) -> ([Option<u64>; 5], bool) {
    let entries = [
        &info.opened,
        &info.commitments_closed,
        &info.randomness,
        &info.closed,
        &info.contribution,
    ];
    let indices = entries.map(|entry| entry.as_ref().map(|receipt| receipt.index));
    (indices, info.invited)
}
