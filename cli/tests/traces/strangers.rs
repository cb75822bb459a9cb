//! Whoever sends a request may send a header with it. It states which trace the request belongs to, and nothing else.

use super::collector::{serving, text, Collector};
use crate::harness::network::LocalNetwork;
use crate::harness::serving::Serving;
use crate::harness::words;
use std::collections::BTreeSet;
use tokio::runtime::Runtime;
use tonic::Request;
use zk0_protocol::rpc::federation::federation_client::FederationClient;
use zk0_protocol::rpc::federation::GetNetworkRequest;

const TRACE: &str = "0af7651916cd43dd8448eb211c80319c";
const SPAN: &str = "b7ad6b7169203331";

fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

#[test]
fn a_header_neither_hides_a_request_nor_adds_to_its_span() {
    let collector = Collector::start();
    let network = LocalNetwork::new();
    network.found(&[]);
    let arguments = serving(&network, &collector.address);
    let mut aggregator = Serving::start(&words(&arguments));
    // It asks not to be recorded.
    let hidden = format!("00-{TRACE}-{SPAN}-00");
    let harmless = [
        "".into(),
        "nothing".into(),
        hidden[1..].to_owned(),
        hidden.to_uppercase(),
        format!("01-{}-{}", &hidden[3..], "f".repeat(6000)),
    ];
    Runtime::new().unwrap().block_on(async {
        let client = FederationClient::connect(aggregator.address.clone()).await;
        let mut client = client.unwrap();
        for header in [&hidden].into_iter().chain(&harmless) {
            let mut request = Request::new(GetNetworkRequest {});
            let metadata = request.metadata_mut();
            metadata.insert("traceparent", header.parse().unwrap());
            metadata.insert("tracestate", "zk0.node=1".parse().unwrap());
            metadata.insert("baggage", "zk0.node=1".parse().unwrap());
            client.get_network(request).await.unwrap();
        }
    });
    assert!(aggregator.terminate().success());
    let spans = collector.spans();
    let requests = spans.named("zk0.v1.Federation/GetNetwork");
    assert_eq!(requests.len(), 1 + harmless.len());
    let named = |span: &&&super::collector::Traced| hex(&span.span.trace_id) == TRACE;
    let joined: Vec<_> = requests.iter().filter(named).collect();
    assert_eq!(joined.len(), 1);
    assert_eq!(hex(&joined[0].span.parent_span_id), SPAN);
    let traces: BTreeSet<_> = requests.iter().map(|one| &one.span.trace_id).collect();
    assert_eq!(traces.len(), requests.len());
    for one in requests {
        assert_eq!(one.span.trace_state, "");
        assert_eq!(text(&one.span.attributes, "zk0.node"), None);
    }
}
