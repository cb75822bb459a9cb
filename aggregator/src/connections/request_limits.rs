//! The requests of a gRPC service: a bounded number in progress, on each connection and in all. Their messages arrive in time and fit into
//! memory. The sender is known before its message is read.
//!
//! A request goes on without its caller. Otherwise a caller could begin requests and leave, while their work waits and keeps their messages
//! in memory. A request that changes nothing and only waits gives up by [`Awaited`].

use crate::connections::answer_body::keeping;
use crate::connections::caller::{Awaited, CallerId, Sender};
use crate::connections::limits::ConnectionLimits;
use crate::connections::message_body::{bounded, Memory};
use crate::connections::message_memory::MessageMemory;
use crate::connections::places::ServedConnection;
use axum::extract::Request;
use axum::http::HeaderMap;
use axum::middleware::Next;
use axum::response::Response;
use futures_core::future::BoxFuture;
use std::sync::Arc;
use std::time::Duration;
use tokio::sync::Semaphore;
use tonic::Status;
use tracing::{info_span, Instrument};

/// Finds the sender of a request by its headers. An invalid head is refused.
pub(crate) type Identify =
    Arc<dyn Fn(HeaderMap) -> BoxFuture<'static, Result<Sender, Status>> + Send + Sync>;

#[derive(Clone)]
pub(crate) struct Requests {
    turns: Arc<Semaphore>,
    identify: Identify,
    memory: MessageMemory,
    message: Duration,
}

impl Requests {
    /// As many requests as `limits` allow with `each` on a connection, and `message` as the time of one message.
    pub fn new(
        limits: &ConnectionLimits,
        each: usize,
        identify: Identify,
        memory: MessageMemory,
        message: Duration,
    ) -> Self {
        let all = limits.most.saturating_mul(each).min(Semaphore::MAX_PERMITS);
        Self {
            turns: Arc::new(Semaphore::new(all)),
            identify,
            memory,
            message,
        }
    }

    pub async fn answer(self, mut request: Request, next: Next) -> Response {
        let Some(connection) = request.extensions().get::<ServedConnection>().cloned() else {
            return Status::internal("a request has no connection").into_http();
        };
        let progress = connection.begin();
        let turns = async {
            let own = connection.turns.clone().acquire_owned().await;
            (own, self.turns.clone().acquire_owned().await)
        };
        let turns = turns.instrument(info_span!("wait for a turn")).await;
        let (Ok(own), Ok(shared)) = turns else {
            return Status::unavailable("the aggregator ends").into_http();
        };
        let turn = (progress, own, shared);
        let (_waits, awaited) = Awaited::begin();
        request.extensions_mut().insert(awaited);
        let work = async move {
            let sender = match (self.identify)(request.headers().clone()).await {
                Ok(sender) => sender,
                Err(refused) => return keeping(refused.into_http(), turn),
            };
            let member = sender.member();
            let caller = member.map_or(CallerId::Stranger(connection.from), CallerId::Node);
            request.extensions_mut().insert(sender);
            let held = Memory::default();
            let reserved = held.clone();
            let request =
                request.map(|body| bounded(body, caller, self.memory, reserved, self.message));
            let response = next.run(request).await;
            drop(held);
            keeping(response, turn)
        };
        tokio::spawn(work.in_current_span())
            .await
            .unwrap_or_else(|_| Status::internal("the request failed").into_http())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::connections::places::ConnectionSlots;
    use axum::body::Body;
    use axum::middleware::from_fn;
    use axum::Router;
    use hyper::service::Service;
    use hyper_util::service::TowerToHyperService;
    use prometheus_client::metrics::gauge::Gauge;
    use std::net::Ipv4Addr;
    use std::sync::atomic::{AtomicUsize, Ordering};
    use tokio::time::{sleep, timeout};

    #[tokio::test]
    async fn a_caller_that_leaves_again_and_again_has_four_requests_in_progress() {
        let limits = ConnectionLimits::default();
        let memory = MessageMemory::new(0, 1 << 20, Gauge::default());
        let nobody: Identify = Arc::new(|_| Box::pin(async { Ok(Sender::default()) }));
        let requests = Requests::new(&limits, 4, nobody, memory, Duration::from_secs(60));
        let (running, most) = (AtomicUsize::new(0), AtomicUsize::new(0));
        let counts = Arc::new([running, most]);
        let counted = counts.clone();
        let work = move || async move {
            let [running, most] = &*counted;
            let now = running.fetch_add(1, Ordering::SeqCst) + 1;
            most.fetch_max(now, Ordering::SeqCst);
            sleep(Duration::from_millis(500)).await;
            running.fetch_sub(1, Ordering::SeqCst);
        };
        let layer = from_fn(move |request, next| requests.clone().answer(request, next));
        let router = Router::new().fallback(work).layer(layer);
        let service = TowerToHyperService::new(router);
        let places = ConnectionSlots::new(&limits, Gauge::default());
        let seat = places.enter(Ipv4Addr::LOCALHOST.into());
        let connection = seat.connection(4);
        for _ in 0..40 {
            let mut request = Request::new(Body::empty());
            request.extensions_mut().insert(connection.clone());
            let _ = timeout(Duration::from_millis(5), service.call(request)).await;
        }
        assert_eq!(counts[1].load(Ordering::SeqCst), 4);
    }
}
