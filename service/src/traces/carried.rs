//! How a trace goes on in another process: a request has the header `traceparent` (W3C Trace Context), with the ids of the trace and of the
//! requesting span.
//!
//! Anybody may send a header. So only these two ids are taken from it, its length is fixed, and it does not decide whether a span is
//! recorded.

use opentelemetry::propagation::{Extractor, Injector, TextMapPropagator};
use opentelemetry::trace::TraceContextExt;
use opentelemetry::Context;
use opentelemetry_sdk::propagation::TraceContextPropagator;
use tonic::codegen::http::{HeaderMap, HeaderValue};
use tonic::metadata::MetadataMap;
use tonic::service::Interceptor;
use tonic::{Request, Status};
use tracing::Span;
use tracing_opentelemetry::OpenTelemetrySpanExt;

/// The header's name.
pub const TRACEPARENT: &str = "traceparent";

/// The header's length in bytes: version, two ids and flags, in hexadecimal, with dashes between.
const LENGTH: usize = 55;

/// Puts the current span into a client's requests, if traces are sent.
#[derive(Clone, Copy, Debug, Default)]
pub struct Carrier;

impl Interceptor for Carrier {
    fn call(&mut self, mut request: Request<()>) -> Result<Request<()>, Status> {
        let context = Span::current().context();
        TraceContextPropagator::new()
            .inject_context(&context, &mut Outgoing(request.metadata_mut()));
        Ok(request)
    }
}

/// An outgoing request's metadata.
struct Outgoing<'a>(&'a mut MetadataMap);

impl Injector for Outgoing<'_> {
    fn set(&mut self, name: &str, value: String) {
        // A trace's state is for other programs; ours has none.
        if let (TRACEPARENT, Ok(value)) = (name, value.parse()) {
            self.0.insert(TRACEPARENT, value);
        }
    }
}

/// The header's value for a request over a protocol other than gRPC; `None` where no traces are sent.
pub fn traceparent() -> Option<String> {
    let mut header = SentHeader::default();
    TraceContextPropagator::new().inject_context(&Span::current().context(), &mut header);
    header.0
}

#[derive(Default)]
struct SentHeader(Option<String>);

impl Injector for SentHeader {
    fn set(&mut self, name: &str, value: String) {
        if name == TRACEPARENT {
            self.0 = Some(value);
        }
    }
}

/// Puts `span`, which has just begun, into the trace that these headers name, if any.
pub fn follow(span: &Span, headers: &HeaderMap) {
    // Without a collector there is no such span.
    if span.is_disabled() {
        return;
    }
    if let Some(parent) = parent(headers) {
        // It fails only for a span that has begun to work.
        let _ = span.set_parent(parent);
    }
}

/// The trace that these headers name; `None` if they name none or several, or have another form.
pub fn parent(headers: &HeaderMap) -> Option<Context> {
    let mut values = headers.get_all(TRACEPARENT).iter();
    let (Some(value), None) = (values.next(), values.next()) else {
        return None;
    };
    let named = ReceivedHeader::of(value)?;
    let context = TraceContextPropagator::new().extract_with_context(&Context::new(), &named);
    let valid = context.span().span_context().is_valid();
    valid.then_some(context)
}

struct ReceivedHeader<'a>(&'a str);

impl<'a> ReceivedHeader<'a> {
    fn of(value: &'a HeaderValue) -> Option<Self> {
        let text = value.to_str().ok()?;
        (text.len() == LENGTH).then_some(Self(text))
    }
}

impl Extractor for ReceivedHeader<'_> {
    fn get(&self, name: &str) -> Option<&str> {
        (name == TRACEPARENT).then_some(self.0)
    }

    fn keys(&self) -> Vec<&str> {
        vec![TRACEPARENT]
    }
}
