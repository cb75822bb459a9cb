//! Counts, times and traces requests, by method and final status. A caller that leaves early counts as `Cancelled`.

use crate::connections::answer_body::watched;
use axum::extract::Request;
use axum::http::HeaderMap;
use axum::middleware::Next;
use axum::response::Response;
use prometheus_client::metrics::counter::Counter;
use prometheus_client::metrics::family::Family;
use prometheus_client::metrics::gauge::Gauge;
use prometheus_client::metrics::histogram::{exponential_buckets, Histogram};
use prost::Message;
use prost_types::FileDescriptorSet;
use std::collections::BTreeSet;
use std::sync::Arc;
use std::time::Instant;
use tonic::Code;
use tracing::{Instrument, Span};
use zk0_protocol::rpc::SERVICES;
use zk0_service::metrics::registry::MetricRegistry;
use zk0_service::traces::request;

/// For unknown paths. Otherwise strangers could fill memory with names.
const OTHER: &str = "other";

type OfMethod = [(&'static str, Arc<str>); 1];

#[derive(Clone)]
pub(crate) struct RequestMetrics {
    methods: Arc<BTreeSet<Arc<str>>>,
    ended: Family<[(&'static str, Arc<str>); 2], Counter>,
    seconds: Family<OfMethod, Histogram, fn() -> Histogram>,
    in_progress: Family<OfMethod, Gauge>,
}

/// From a millisecond to four minutes.
fn times() -> Histogram {
    Histogram::new(exponential_buckets(0.001, 4.0, 10))
}

impl RequestMetrics {
    pub fn registered(registry: &mut MetricRegistry) -> Self {
        let metrics = Self {
            methods: Arc::new(methods()),
            ended: Family::default(),
            seconds: Family::new_with_constructor(times),
            in_progress: Family::default(),
        };
        registry.register(
            "requests",
            "Requests that have ended, by method and by gRPC status",
            metrics.ended.clone(),
        );
        registry.register(
            "request_seconds",
            "Time from a request to the end of its answer",
            metrics.seconds.clone(),
        );
        registry.register(
            "requests_in_progress",
            "Requests that are being answered",
            metrics.in_progress.clone(),
        );
        metrics
    }

    pub async fn answer(self, request: Request, next: Next) -> Response {
        let counted = Counted::begin(self, request.uri().path(), request.headers());
        let response = next.run(request).instrument(counted.span.clone()).await;
        // The status comes last, or at once without messages.
        if let Some(code) = status(response.headers()) {
            counted.end(code);
            return response;
        }
        let mut counted = Some(counted);
        watched(response, move |frame| {
            if let Some(code) = frame.trailers_ref().and_then(status) {
                if let Some(counted) = counted.take() {
                    counted.end(code);
                }
            }
        })
    }
}

fn methods() -> BTreeSet<Arc<str>> {
    let described = FileDescriptorSet::decode(SERVICES).unwrap_or_default();
    let files = described.file.iter();
    let methods = files.flat_map(|file| {
        file.service.iter().flat_map(|service| {
            let name = |method: &str| format!("{}.{}/{method}", file.package(), service.name());
            service
                .method
                .iter()
                .map(move |method| name(method.name()).into())
        })
    });
    methods.collect()
}

fn status(headers: &HeaderMap) -> Option<Code> {
    let code = headers.get("grpc-status")?;
    Some(Code::from_bytes(code.as_bytes()))
}

/// Dropped early, it means that the caller has left.
struct Counted {
    metrics: RequestMetrics,
    method: Arc<str>,
    span: Span,
    begun: Instant,
    code: Code,
}

impl Counted {
    fn begin(metrics: RequestMetrics, path: &str, headers: &HeaderMap) -> Self {
        let known = metrics.methods.get(path.trim_start_matches('/'));
        let known = known.and_then(|known| known.split_once('/'));
        let service = known.map_or(OTHER, |(service, _)| service);
        let method: Arc<str> = match known {
            Some((_, method)) => method.into(),
            None => OTHER.into(),
        };
        let span = request::begin(service, &method, headers);
        let of_method = [("method", method.clone())];
        metrics.in_progress.get_or_create(&of_method).inc();
        Self {
            metrics,
            method,
            span,
            begun: Instant::now(),
            code: Code::Cancelled,
        }
    }

    fn end(mut self, code: Code) {
        self.code = code;
    }
}

impl Drop for Counted {
    fn drop(&mut self) {
        let (metrics, method) = (&self.metrics, &self.method);
        let of_method = [("method", method.clone())];
        metrics.in_progress.get_or_create(&of_method).dec();
        let seconds = self.begun.elapsed().as_secs_f64();
        metrics.seconds.get_or_create(&of_method).observe(seconds);
        let status = format!("{:?}", self.code).into();
        let ended = [("method", method.clone()), ("status", status)];
        metrics.ended.get_or_create(&ended).inc();
        request::end(&self.span, self.code);
    }
}
