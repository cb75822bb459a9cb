//! The server states whether it is in order, and which services it has.

use crate::Test;
use tonic::transport::{Channel, Endpoint};
use tonic::Code;
use tonic_reflection::pb::v1::server_reflection_client::ServerReflectionClient;
use tonic_reflection::pb::v1::server_reflection_request::MessageRequest;
use tonic_reflection::pb::v1::server_reflection_response::MessageResponse;
use tonic_reflection::pb::v1::ServerReflectionRequest;
use zk0_aggregator::Config;
use zk0_protocol::rpc::health::health_check_response::ServingStatus;
use zk0_protocol::rpc::health::health_client::HealthClient;
use zk0_protocol::rpc::health::HealthCheckRequest;
use zk0_testkit::aggregator::{Network, SigningNode};

async fn served() -> (Network, Channel) {
    let config = Config {
        rounds: Some(1),
        min_nodes: 1,
    };
    let network = Network::start(&[&SigningNode::new(1)], config).await;
    let endpoint = Endpoint::try_from(network.address.clone()).unwrap();
    let channel = endpoint.connect().await.unwrap();
    (network, channel)
}

fn about(service: &str) -> HealthCheckRequest {
    HealthCheckRequest {
        service: service.into(),
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_monitor_hears_that_the_aggregator_is_in_order() -> Test {
    let (_network, channel) = served().await;
    let mut client = HealthClient::new(channel);
    for service in ["", "zk0.v1.Federation"] {
        let answer = client.check(about(service)).await?.into_inner();
        assert_eq!(answer.status(), ServingStatus::Serving, "{service}");
        let mut stream = client.watch(about(service)).await?.into_inner();
        let first = stream.message().await?.unwrap();
        assert_eq!(first.status(), ServingStatus::Serving, "{service}");
    }
    let status = client.check(about("other")).await.unwrap_err();
    assert_eq!(status.code(), Code::NotFound, "{status}");
    Ok(())
}

#[tokio::test(flavor = "multi_thread")]
async fn a_client_hears_which_services_there_are() -> Test {
    let (_network, channel) = served().await;
    let request = ServerReflectionRequest {
        host: String::new(),
        message_request: Some(MessageRequest::ListServices(String::new())),
    };
    let asked = tokio_stream::once(request);
    let mut client = ServerReflectionClient::new(channel);
    let mut answers = client.server_reflection_info(asked).await?.into_inner();
    let answer = answers.message().await?.unwrap().message_response;
    let Some(MessageResponse::ListServicesResponse(list)) = answer else {
        panic!("{answer:?}");
    };
    let names: Vec<_> = list
        .service
        .iter()
        .map(|service| &service.name[..])
        .collect();
    for name in ["zk0.v1.Federation", "grpc.health.v1.Health"] {
        assert!(names.contains(&name), "{names:?}");
    }
    Ok(())
}
