//! How a trace goes on in another process: a request has the header `traceparent` (W3C Trace Context), with the ids of the trace and of the span
//! that makes the request.
//!
//! Anybody may send a header. So nothing but these two ids is taken from it, it has a fixed length, and whether a span is recorded does not depend on
//! it.

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

/// The name of the header.
pub const TRACEPARENT: &str = "traceparent";

/// The length of the header, in bytes: its version, two ids and a byte of flags, in hexadecimal digits with dashes in between.
const LENGTH: usize = 55;

/// Puts the current span into the requests of a client. It adds nothing where no traces are sent.
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

/// The metadata of a request that goes out.
struct Outgoing<'a>(&'a mut MetadataMap);

impl Injector for Outgoing<'_> {
    fn set(&mut self, name: &str, value: String) {
        // The state of a trace is for other programs' traces, and ours has none.
        if let (TRACEPARENT, Ok(value)) = (name, value.parse()) {
            self.0.insert(TRACEPARENT, value);
        }
    }
}

/// The value of the header for a request that the current span makes with another protocol than gRPC; `None` where no traces are sent.
pub fn traceparent() -> Option<String> {
    let mut header = SentHeader::default();
    TraceContextPropagator::new().inject_context(&Span::current().context(), &mut header);
    header.0
}

/// The header of one request that goes out.
#[derive(Default)]
struct SentHeader(Option<String>);

impl Injector for SentHeader {
    fn set(&mut self, name: &str, value: String) {
        if name == TRACEPARENT {
            self.0 = Some(value);
        }
    }
}

/// Lets `span`, which has just begun, belong to the trace of whoever makes the request with these headers, if they say which that is.
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

/// Where the trace of a request with these headers goes on; `None` if they do not say it, or say it more than once or in another form.
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

/// The one header that is read.
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
