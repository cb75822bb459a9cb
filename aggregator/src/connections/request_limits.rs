//! The requests of a gRPC service: a bounded number in progress, on each connection and in all, whose messages arrive in time and fit
//! into memory. An answer that names its author makes the connection the author's.
//!
//! Once a request has begun, it goes on although its caller is gone. Otherwise a caller could begin a request, leave, and begin the next,
//! while the work of all of them waits for its turn and keeps their messages in memory. [`Awaited`] tells a request that its caller is gone: one
//! that changes nothing and only waits gives up.

use crate::connections::answer_body::keeping;
use crate::connections::caller::{Author, Awaited, Caller, InProgress};
use crate::connections::limits::ConnectionLimits;
use crate::connections::message_body::{Memory, MessageBody};
use crate::connections::message_memory::MessageMemory;
use axum::body::Body;
use axum::extract::Request;
use axum::middleware::Next;
use axum::response::Response;
use std::sync::Arc;
use std::time::Duration;
use tokio::sync::{OwnedSemaphorePermit, Semaphore};
use tonic::Status;
use tracing::{info_span, Instrument};

/// What the requests of a service may take.
#[derive(Clone)]
pub(crate) struct Requests {
    turns: Arc<Semaphore>,
    memory: MessageMemory,
    message: Duration,
}

impl Requests {
    /// As many requests as `limits` allow with `each` on a connection. A message may take as long as `message`.
    pub fn new(
        limits: &ConnectionLimits,
        each: usize,
        memory: MessageMemory,
        message: Duration,
    ) -> Self {
        let all = limits.most.saturating_mul(each).min(Semaphore::MAX_PERMITS);
        Self {
            turns: Arc::new(Semaphore::new(all)),
            memory,
            message,
        }
    }

    /// Answers a request by `next`.
    pub async fn answer(self, mut request: Request, next: Next) -> Response {
        let Some(caller) = request.extensions().get::<Caller>().cloned() else {
            return Status::internal("a request has no connection").into_http();
        };
        let turns = async {
            let own = caller.turns.clone().acquire_owned().await;
            (own, self.turns.clone().acquire_owned().await)
        };
        let turns = turns.instrument(info_span!("wait for a turn")).await;
        let (Ok(own), Ok(shared)) = turns else {
            return Status::unavailable("the aggregator ends").into_http();
        };
        let turn = RequestPermit {
            _progress: caller.begin(),
            _permits: [own, shared],
        };
        let (_waits, awaited) = Awaited::begin();
        request.extensions_mut().insert(awaited);
        let work = async move {
            let held = Memory::default();
            let request = request.map(|body| {
                let (caller, held) = (caller.clone(), held.clone());
                Body::new(MessageBody::new(
                    body,
                    caller,
                    self.memory,
                    held,
                    self.message,
                ))
            });
            let response = next.run(request).await;
            drop(held);
            if let Some(Author(node)) = response.extensions().get() {
                caller.is(*node);
            }
            keeping(response, turn)
        };
        tokio::spawn(work.in_current_span())
            .await
            .unwrap_or_else(|_| Status::internal("the request failed").into_http())
    }
}

/// A request's turn, until it is dropped.
struct RequestPermit {
    _progress: InProgress,
    _permits: [OwnedSemaphorePermit; 2],
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::connections::places::ConnectionSlots;
    use axum::middleware::from_fn;
    use axum::Router;
    use hyper::service::Service;
    use hyper_util::service::TowerToHyperService;
    use std::net::Ipv4Addr;
    use std::sync::atomic::{AtomicUsize, Ordering};
    use tokio::time::{sleep, timeout};

    #[tokio::test]
    async fn a_caller_that_leaves_again_and_again_has_four_requests_in_progress() {
        let limits = ConnectionLimits::default();
        let memory = MessageMemory::new(0, 1 << 20);
        let requests = Requests::new(&limits, 4, memory, Duration::from_secs(60));
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
        let seat = ConnectionSlots::new(limits).enter(Ipv4Addr::LOCALHOST.into());
        let caller = Caller::new(&seat.unwrap(), 4);
        for _ in 0..40 {
            let mut request = Request::new(Body::empty());
            request.extensions_mut().insert(caller.clone());
            let _ = timeout(Duration::from_millis(5), service.call(request)).await;
        }
        assert_eq!(counts[1].load(Ordering::SeqCst), 4);
    }
}
