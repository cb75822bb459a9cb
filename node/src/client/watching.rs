//! Following a round: the aggregator tells the node when a round has come further.

use crate::client::heads::About;
use crate::client::waits::Waits;
use crate::client::{program, unexpected, NodeClient};
use crate::client_error::NodeError;
use crate::observe::AskedService;
use std::time::Duration;
use tonic::Streaming;
use zk0_protocol::entries::entry::{Body, RoundClosed, RoundOpened};
use zk0_protocol::entries::program::Program;
use zk0_protocol::request_head::Method;
use zk0_protocol::rpc::federation as rpc;

/// A given round, or the last one.
pub(crate) struct FollowedRound {
    request: rpc::GetRoundRequest,
    stream: Option<Streaming<rpc::RoundInfo>>,
    waits: Waits,
}

impl FollowedRound {
    pub fn of(round: Option<u64>, node: Vec<u8>) -> Self {
        Self {
            request: rpc::GetRoundRequest { round, node },
            stream: None,
            waits: Waits::default(),
        }
    }
}

/// The wait for a round's close.
pub struct WaitForClose {
    round: u64,
    followed: FollowedRound,
}

/// The result of waiting for a round's close.
#[derive(Clone, Debug)]
pub enum Waited {
    /// The round is closed.
    Closed(Box<RoundClosed>),
    /// The aggregator has lost a file of the node's contribution, without which the round cannot close.
    Lost,
}

/// An open round to which the node may contribute.
#[derive(Clone, Debug)]
pub struct OpenRound {
    /// How it opened.
    pub opened: RoundOpened,
    /// The guest program of its proofs, as the aggregator states it.
    pub program: Program,
}

impl NodeClient {
    /// Waits until `round` is open, or a later one if it has closed, or the rules do not let this node contribute to it.
    pub async fn wait_for_round(&mut self, round: u64) -> Result<OpenRound, NodeError> {
        let mut left_out = None;
        let mut watch = FollowedRound::of(None, self.id().0.to_vec());
        loop {
            let info = self.next_stage(&mut watch).await?;
            if let (Some(opened), None) = (info.opened, info.closed) {
                let (receipt, signed, entry) = self.opened(opened)?;
                match entry.body {
                    Body::RoundOpened(opened) if opened.round >= round && info.invited => {
                        let program = program(&info.program)?;
                        // A key that came after the opening may have signed a later checkpoint.
                        let is_key_there = signed.since <= receipt.index;
                        self.opening = is_key_there.then_some((opened.round, signed.key));
                        return Ok(OpenRound { opened, program });
                    }
                    Body::RoundOpened(opened) => {
                        let number = opened.round;
                        if number >= round && left_out.replace(number) != Some(number) {
                            tracing::warn!(
                                "round {number} is open, but this node may not contribute to it, and waits for a later one: it is not invited, or not active, or it has left; its dataset came too late or is too small, or it pauses because its last commitments ended without an accepted contribution"
                            );
                        }
                    }
                    _ => return Err(unexpected("the opening of a round", "another entry")),
                }
            }
        }
    }

    /// Waits until `round` is closed, or until the aggregator names lost files of this node's contribution.
    pub async fn wait_for_close(&mut self, watch: &mut WaitForClose) -> Result<Waited, NodeError> {
        loop {
            let info = self.next_stage(&mut watch.followed).await?;
            if let Some(closed) = info.closed {
                return match self.entry(closed)?.1.body {
                    Body::RoundClosed(closed) if closed.round == watch.round => {
                        Ok(Waited::Closed(Box::new(closed)))
                    }
                    _ => Err(unexpected("the close of the round", "another entry")),
                };
            }
            if !info.lost.is_empty() {
                return Ok(Waited::Lost);
            }
        }
    }

    /// Begins to wait until `round` is closed.
    pub fn until_closed(&self, round: u64) -> WaitForClose {
        WaitForClose {
            round,
            followed: FollowedRound::of(Some(round), self.id().0.to_vec()),
        }
    }

    /// Whether the aggregator states that `round` takes no more commitments.
    pub(crate) async fn commits_no_more(&mut self, round: u64) -> Result<bool, NodeError> {
        let mut watch = FollowedRound::of(Some(round), Vec::new());
        let info = self.next_stage(&mut watch).await?;
        Ok(info.commitments_closed.is_some() || info.closed.is_some())
    }

    /// How long the aggregator still takes submissions for this round, as it states: no time after the close.
    pub(crate) async fn submissions_end_in(
        &mut self,
        opened: &RoundOpened,
    ) -> Result<Duration, NodeError> {
        let mut watch = FollowedRound::of(Some(opened.round), Vec::new());
        let info = self.next_stage(&mut watch).await?;
        let window_ms = opened.rules.submit_window_ms;
        let left_ms = match (info.closed, info.randomness) {
            (Some(_), _) => 0,
            (None, Some(drawn)) => {
                let drawn_ms = self.entry(drawn)?.1.time_ms;
                let ends_ms = drawn_ms
                    .saturating_add(window_ms)
                    .saturating_add(info.moved_ms);
                ends_ms.saturating_sub(info.now_ms)
            }
            (None, None) => window_ms,
        };
        Ok(Duration::from_millis(left_ms))
    }

    pub(crate) async fn closed_round(
        &mut self,
        round: u64,
    ) -> Result<(RoundOpened, RoundClosed), NodeError> {
        let mut watch = FollowedRound::of(Some(round), Vec::new());
        let info = self.next_stage(&mut watch).await?;
        let wanted = "the opening and the close of a round that is over";
        let (Some(opened), Some(closed)) = (info.opened, info.closed) else {
            return Err(unexpected(wanted, "less"));
        };
        match (self.entry(opened)?.1.body, self.entry(closed)?.1.body) {
            (Body::RoundOpened(opened), Body::RoundClosed(closed))
                if opened.round == round && closed.round == round =>
            {
                Ok((opened, closed))
            }
            _ => Err(unexpected(wanted, "other entries")),
        }
    }

    /// A node that names itself shows that it is present.
    fn watching(
        &self,
        watch: &FollowedRound,
    ) -> Result<tonic::Request<rpc::GetRoundRequest>, NodeError> {
        let message = watch.request.clone();
        if message.node.is_empty() {
            return Ok(tonic::Request::new(message));
        }
        let about = About::message(Method::WatchRound, &message.node);
        let about = match message.round {
            Some(round) => about.in_round(round),
            None => about,
        };
        self.headed(&about, message)
    }

    /// Waits until the round of `watch` has come further. The first call returns at once.
    pub(crate) async fn next_stage(
        &mut self,
        watch: &mut FollowedRound,
    ) -> Result<rpc::RoundInfo, NodeError> {
        loop {
            let told = match &mut watch.stream {
                Some(stream) => stream.message().await,
                None => match self.client.watch_round(self.watching(watch)?).await {
                    Ok(stream) => {
                        watch.stream = Some(stream.into_inner());
                        continue;
                    }
                    Err(status) => Err(status),
                },
            };
            let failure = match told {
                Ok(Some(info)) => {
                    watch.waits.end();
                    self.metrics.answered(AskedService::Aggregator);
                    return Ok(info);
                }
                // The aggregator ends the stream after some minutes.
                Ok(None) => None,
                Err(failure) => Some(failure),
            };
            watch.stream = None;
            match failure {
                Some(failure) => self.again(&mut watch.waits, failure).await?,
                None => {
                    watch.waits.shortly().await;
                    // If the aggregator does not answer yet, the next request shows that.
                    let _ = self.learn_run().await;
                }
            }
        }
    }
}
