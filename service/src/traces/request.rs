//! The span of a request to a gRPC service. Its fields follow OpenTelemetry's conventions for gRPC, plus the request's node and round.

use crate::traces::carried;
use tonic::codegen::http::HeaderMap;
use tonic::Code;
use tracing::field::{display, Empty};
use tracing::{info_span, Span};

/// Begins the span of a request to this method of this service, such as `Submit` of `zk0.v1.Federation`, in the trace that the headers
/// name, if any. The names must not come from the caller, who could fill the collector with them.
pub fn begin(service: &str, method: &str, headers: &HeaderMap) -> Span {
    let span = info_span!(
        "request",
        otel.name = %format_args!("{service}/{method}"),
        otel.kind = "server",
        otel.status_code = Empty,
        rpc.system = "grpc",
        rpc.service = service,
        rpc.method = method,
        rpc.grpc.status_code = Empty,
        zk0.node = Empty,
        zk0.round = Empty,
        zk0.outcome = Empty,
    );
    carried::follow(&span, headers);
    span
}

/// Records the current span's node and round.
pub fn sent_by(node: impl std::fmt::Display, round: Option<u64>) {
    let span = Span::current();
    span.record("zk0.node", display(node));
    if let Some(round) = round {
        span.record("zk0.round", round);
    }
}

/// Records the current span's outcome.
pub fn outcome(what: impl std::fmt::Display) {
    Span::current().record("zk0.outcome", display(what));
}

/// Records the status that answered this span's request.
pub fn end(span: &Span, code: Code) {
    span.record("rpc.grpc.status_code", code as i64);
    // A caller's mistake is no error of the service.
    let ours = [
        Code::Unknown,
        Code::DeadlineExceeded,
        Code::Unimplemented,
        Code::Internal,
        Code::Unavailable,
        Code::DataLoss,
    ];
    if ours.contains(&code) {
        span.record("otel.status_code", "ERROR");
    }
}
