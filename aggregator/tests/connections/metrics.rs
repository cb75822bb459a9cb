//! What the metrics state of requests.

use super::network;
use crate::Test;
use tonic::client::Grpc;
use tonic::codegen::http::uri::PathAndQuery;
use tonic::transport::Endpoint;
use tonic::{Code, Request};
use tonic_prost::ProstCodec;
use zk0_aggregator::Limits;
use zk0_protocol::rpc::federation::{GetStatusRequest, StatusInfo};

#[tokio::test(flavor = "multi_thread")]
async fn requests_to_methods_that_do_not_exist_are_counted_together() -> Test {
    let (network, _) = network(Limits::default()).await;
    let channel = Endpoint::try_from(network.address.clone())?
        .connect()
        .await?;
    let mut client = Grpc::new(channel);
    for number in 0..20 {
        for service in ["zk0.v1.Federation", "made.up.Service"] {
            client.ready().await?;
            let path = PathAndQuery::try_from(format!("/{service}/MadeUp{number}"))?;
            let codec = ProstCodec::<GetStatusRequest, StatusInfo>::default();
            let asked = client.unary(Request::new(GetStatusRequest {}), path, codec);
            assert_eq!(asked.await.unwrap_err().code(), Code::Unimplemented);
        }
    }
    network
        .client()
        .await
        .get_status(GetStatusRequest {})
        .await?;
    let text = network.service().metrics().text()?;
    let counted = |name: &str| text.lines().any(|line| line == name);
    let other = r#"zk0_requests_total{method="other",status="Unimplemented"} 40"#;
    assert!(counted(other) && !text.contains("MadeUp"), "{text}");
    let known = r#"zk0_requests_total{method="GetStatus",status="Ok"} 1"#;
    assert!(counted(known), "{text}");
    Ok(())
}
