//! The header that names a trace: what is taken from it, and in which form alone.

use opentelemetry::trace::TraceContextExt;
use tonic::codegen::http::HeaderMap;
use zk0_service::traces::carried::{parent, TRACEPARENT};

const TRACE: &str = "0af7651916cd43dd8448eb211c80319c";
const SPAN: &str = "b7ad6b7169203331";

fn headers(values: &[&str]) -> HeaderMap {
    let mut headers = HeaderMap::new();
    for value in values {
        headers.append(TRACEPARENT, value.parse().unwrap());
    }
    headers
}

#[test]
fn a_header_names_a_trace_and_a_span_and_nothing_else_counts() {
    for flags in ["00", "01", "ff"] {
        let mut headers = headers(&[&format!("00-{TRACE}-{SPAN}-{flags}")]);
        headers.insert("tracestate", "other=1".parse().unwrap());
        headers.insert("baggage", "secret=1".parse().unwrap());
        let context = parent(&headers).unwrap();
        let span = context.span().span_context().clone();
        assert_eq!(span.trace_id().to_string(), TRACE);
        assert_eq!(span.span_id().to_string(), SPAN);
        assert!(span.is_remote());
        assert_eq!(span.trace_state().header(), "");
    }
}

#[test]
fn a_header_in_another_form_is_not_taken() {
    let right = format!("00-{TRACE}-{SPAN}-01");
    let long = format!("01-{TRACE}-{SPAN}-01-{}", "f".repeat(8000));
    let zeros = format!("00-{}-{SPAN}-01", "0".repeat(32));
    let wrong = [
        "",
        "00",
        &right[1..],
        &right.to_uppercase(),
        &right.replace('-', "_"),
        &format!("{right}-"),
        &format!("ff{}", &right[2..]),
        &long,
        &zeros,
    ];
    for value in wrong {
        assert!(parent(&headers(&[value])).is_none(), "{value}");
    }
    assert!(parent(&headers(&[])).is_none());
    assert!(parent(&headers(&[&right, &right])).is_none());
    assert!(parent(&headers(&[&right])).is_some());
}
