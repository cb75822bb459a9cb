//! Traces for OpenTelemetry: what took how long, from a node's training to the verification of its proof.
//!
//! The crates of the services open spans with `tracing`. Nothing is done with them unless the operator names a collector.
//!
//! A short tour:
//! - [`export`]: sends the spans of this process to a collector (OTLP over gRPC). A collector that is down or slow costs nothing but spans.
//! - [`request`]: the span of a request that a gRPC service answers.
//! - [`carried`]: how a trace goes on in another process: in the metadata of a request (W3C Trace Context).

pub mod carried;
pub mod export;
pub mod request;
