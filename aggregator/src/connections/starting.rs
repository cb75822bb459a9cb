//! What the gRPC port answers while an aggregator starts, which may take minutes on a long ledger: how far it is, and when to ask again.
//! Health checks get `NOT_SERVING`, and so does `/health` beside the metrics.

use crate::connections::limits::ConnectionLimits;
use crate::connections::serving::Serving;
use crate::connections::windows::Windows;
use crate::observe::connections::ConnectionMetrics;
use crate::publish::http::{self, HttpLimits};
use crate::start_progress::StartProgress;
use axum::extract::Request as Asked;
use axum::middleware::{from_fn, Next};
use axum::response::Response as Answer;
use axum::Router;
use hyper_util::rt::{TokioExecutor, TokioTimer};
use hyper_util::server::conn::auto::Builder;
use std::future::pending;
use std::io;
use std::net::TcpListener as SystemListener;
use std::sync::Arc;
use std::thread::{self, JoinHandle};
use std::time::Duration;
use tokio::net::TcpListener;
use tokio::runtime;
use tokio::sync::oneshot;
use tokio::time::timeout;
use tokio_stream::Once;
use tonic::service::Routes;
use tonic::{Code, Request, Response, Status};
use zk0_protocol::rpc::federation::{turned_down::Remedy, TurnedDown};
use zk0_protocol::rpc::health::health_check_response::ServingStatus;
use zk0_protocol::rpc::health::health_server::{Health, HealthServer};
use zk0_protocol::rpc::health::{HealthCheckRequest, HealthCheckResponse};
use zk0_service::metrics::endpoint;
use zk0_service::tls::server_certificate::ServerCertificate;

/// Milliseconds until a new try.
const AFTER_MS: u64 = 2000;

/// Requests in progress on one connection.
const REQUESTS: usize = 4;

/// The largest message, in bytes: the name of a service.
const MESSAGE_BYTES: usize = 1024;

/// For one request, whose message is that small.
const REQUEST: Duration = Duration::from_secs(5);

/// Time at the end for answers, which take no time.
const DRAIN: Duration = Duration::from_secs(1);

/// Answers that the aggregator starts, in a thread of its own, until it is dropped.
pub struct StartingServer {
    stop: Option<oneshot::Sender<()>>,
    thread: Option<JoinHandle<()>>,
}

impl StartingServer {
    /// Answers on `listener` within `limits`, and on that of the metrics. Both stay open for the aggregator.
    ///
    /// # Errors
    /// The system has no more threads or open files.
    pub fn begin(
        listener: &SystemListener,
        metrics: Option<&SystemListener>,
        certificate: Option<&Arc<ServerCertificate>>,
        limits: ConnectionLimits,
        progress: StartProgress,
    ) -> io::Result<Self> {
        let listener = listener.try_clone()?;
        let metrics = metrics.map(SystemListener::try_clone).transpose()?;
        let runtime = runtime::Builder::new_current_thread()
            .enable_all()
            .build()?;
        let (stop, stopped) = oneshot::channel::<()>();
        let acceptor = certificate.map(|certificate| certificate.acceptor("h2"));
        let answering = async move {
            let registered = TcpListener::from_std(listener);
            let metrics = metrics.map(TcpListener::from_std).transpose();
            let (listener, metrics) = match registered.and_then(|one| Ok((one, metrics?))) {
                Ok(listeners) => listeners,
                Err(error) => return tracing::warn!("nothing answers before the start: {error}"),
            };
            if let Some(metrics) = metrics {
                let router = endpoint::router(progress.clone());
                tokio::spawn(http::serve(
                    metrics,
                    router,
                    HttpLimits::default(),
                    pending(),
                ));
            }
            let mut protocol = Builder::new(TokioExecutor::new()).http2_only();
            protocol
                .http2()
                .timer(TokioTimer::new())
                .max_concurrent_streams(REQUESTS as u32);
            let refused = move || {
                let answer: Answer = turned_down(&progress).into_http();
                async move { answer }
            };
            let health = HealthServer::new(StartingHealth);
            let health = Routes::new(health.max_decoding_message_size(MESSAGE_BYTES));
            let router = health.prepare().into_axum_router().fallback(refused);
            let serving = Serving {
                limits: ConnectionLimits {
                    drain: DRAIN,
                    ..limits
                },
                protocol,
                windows: Windows::new(),
                requests: REQUESTS,
                tls: acceptor,
                router: in_time(router, REQUEST),
                metrics: ConnectionMetrics::default(),
            };
            let stopped = async {
                let _ = stopped.await;
            };
            serving.serve(listener, stopped).await;
        };
        let thread = thread::Builder::new().spawn(move || runtime.block_on(answering))?;
        Ok(Self {
            stop: Some(stop),
            thread: Some(thread),
        })
    }
}

impl Drop for StartingServer {
    fn drop(&mut self) {
        drop(self.stop.take());
        if let Some(thread) = self.thread.take() {
            // A panic there is logged, and the aggregator goes on.
            let _ = thread.join();
        }
    }
}

/// The routes, with `patience` for each request.
fn in_time(router: Router, patience: Duration) -> Router {
    router.layer(from_fn(move |request: Asked, next: Next| async move {
        let answered = timeout(patience, next.run(request)).await;
        answered
            .unwrap_or_else(|_| Status::deadline_exceeded("the request took too long").into_http())
    }))
}

fn turned_down(progress: &StartProgress) -> Status {
    let details = TurnedDown {
        code: 0,
        remedy: Remedy::AskAgain.into(),
        after_ms: AFTER_MS,
    };
    details.status(Code::Unavailable, format!("{progress}: ask again"))
}

struct StartingHealth;

fn not_serving() -> HealthCheckResponse {
    HealthCheckResponse {
        status: ServingStatus::NotServing.into(),
    }
}

#[tonic::async_trait]
impl Health for StartingHealth {
    async fn check(
        &self,
        _: Request<HealthCheckRequest>,
    ) -> Result<Response<HealthCheckResponse>, Status> {
        Ok(Response::new(not_serving()))
    }

    type WatchStream = Once<Result<HealthCheckResponse, Status>>;

    async fn watch(
        &self,
        _: Request<HealthCheckRequest>,
    ) -> Result<Response<Self::WatchStream>, Status> {
        Ok(Response::new(tokio_stream::once(Ok(not_serving()))))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use axum::body::Body;
    use hyper::service::Service;
    use hyper_util::service::TowerToHyperService;

    #[tokio::test]
    async fn a_request_takes_a_bounded_time() {
        let router = in_time(Router::new().fallback(pending::<Answer>), Duration::ZERO);
        let service = TowerToHyperService::new(router);
        let answered = service.call(Asked::new(Body::empty())).await.unwrap();
        let status = Status::from_header_map(answered.headers()).unwrap();
        assert_eq!(status.code(), Code::DeadlineExceeded);
    }
}
