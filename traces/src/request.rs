//! The span of a request that a gRPC service answers. Its fields are those of OpenTelemetry's conventions for gRPC, and the node and the round that
//! the request is about.

use crate::carried;
use tonic::codegen::http::HeaderMap;
use tonic::Code;
use tracing::field::{display, Empty};
use tracing::{info_span, Span};

/// Begins the span of a request to this method of this service, such as `Submit` of `zk0.v1.Federation`. It belongs to the trace of whoever makes
/// the request, if the headers say which that is. The names must not come from the caller: otherwise strangers could fill the collector with names.
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

/// The request of the current span comes from this node, and is about this round.
pub fn sent_by(node: impl std::fmt::Display, round: Option<u64>) {
    let span = Span::current();
    span.record("zk0.node", display(node));
    if let Some(round) = round {
        span.record("zk0.round", round);
    }
}

/// The request, or the turn, of the current span came to this.
pub fn outcome(what: impl std::fmt::Display) {
    Span::current().record("zk0.outcome", display(what));
}

/// The request of this span was answered with this status.
pub fn end(span: &Span, code: Code) {
    span.record("rpc.grpc.status_code", code as i64);
    // What a caller does wrong is no error of the service.
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
