//! Traces for OpenTelemetry: what took how long, from a node's training to the verification of its proof.
//!
//! The services' crates open spans with `tracing`, which are used only if the operator names a collector.
//!
//! - [`export`]: sends this process's spans to a collector (OTLP over gRPC). A collector that is down or slow costs only spans.
//! - [`request`]: the span of a request to a gRPC service.
//! - [`carried`]: carries a trace to another process in a request's metadata (W3C Trace Context).

pub mod carried;
pub mod export;
pub mod request;
