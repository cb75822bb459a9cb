//! HTTP/2 for the gRPC service, under limits, with gRPC's health checks and reflection.

use crate::connections::message_memory::MessageMemory;
use crate::connections::request_limits::{Identify, Requests};
use crate::connections::serving::Serving;
use crate::connections::windows::Windows;
use crate::observe::metrics::Metrics;
use crate::observe::troubles::Troubles;
use crate::serve::health::HealthyService;
use crate::serve::limits::{Limits, CONCURRENT};
use axum::middleware::from_fn;
use hyper_util::rt::{TokioExecutor, TokioTimer};
use hyper_util::server::conn::auto::Builder;
use std::future::Future;
use std::sync::Arc;
use std::time::Duration;
use tokio::net::TcpListener;
use tokio::sync::watch;
use tonic::service::Routes;
use tonic_reflection::server as reflection;
use zk0_protocol::rpc::health::health_server::HealthServer;
use zk0_protocol::rpc::SERVICES;
use zk0_service::tls::server_certificate::ServerCertificate;

/// How often the server pings a connection, and how long it waits.
const KEEPALIVE: Duration = Duration::from_secs(60);

/// Bytes of an answer that wait for a slow reader.
const SEND_BYTES: usize = 64 << 10;

pub(super) struct Grpc {
    pub limits: Limits,
    pub largest_message: u64,
    pub identify: Identify,
    pub certificate: Option<Arc<ServerCertificate>>,
    pub metrics: Metrics,
    pub troubles: Troubles,
    /// Whether the service ends.
    pub ending: watch::Receiver<bool>,
}

impl Grpc {
    /// Serves `routes` on `listener` until `stop` is ready and the open requests are answered, or have had their time.
    pub async fn serve(
        self,
        listener: TcpListener,
        routes: Routes,
        stop: impl Future<Output = ()>,
    ) {
        let mut protocol = Builder::new(TokioExecutor::new()).http2_only();
        protocol
            .http2()
            .timer(TokioTimer::new())
            .max_concurrent_streams(CONCURRENT as u32)
            .max_send_buf_size(SEND_BYTES)
            .keep_alive_interval(KEEPALIVE)
            .keep_alive_timeout(KEEPALIVE);
        let Limits {
            connections,
            message,
            message_memory,
            watch,
            ..
        } = self.limits;
        let in_flight = self.metrics.message_bytes;
        let memory = MessageMemory::new(message_memory, self.largest_message, in_flight);
        let requests = Requests::new(&connections, CONCURRENT, self.identify, memory, message);
        let in_order = HealthyService {
            troubles: self.troubles,
            ending: self.ending,
            longest: watch,
        };
        let mut routes = routes.add_service(HealthServer::new(in_order));
        let reflection =
            reflection::Builder::configure().register_encoded_file_descriptor_set(SERVICES);
        match reflection.build_v1() {
            Ok(reflection) => routes = routes.add_service(reflection),
            Err(error) => tracing::error!("the server cannot state what its services are: {error}"),
        }
        let router = routes.prepare().into_axum_router();
        let answered = self.metrics.requests;
        let serving = Serving {
            limits: connections,
            protocol,
            windows: Windows::new(),
            requests: CONCURRENT,
            tls: self
                .certificate
                .map(|certificate| certificate.acceptor("h2")),
            metrics: self.metrics.connections,
            router: router
                .layer(from_fn(move |request, next| {
                    requests.clone().answer(request, next)
                }))
                .layer(from_fn(move |request, next| {
                    answered.clone().answer(request, next)
                })),
        };
        serving.serve(listener, stop).await;
    }
}
