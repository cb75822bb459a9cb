//! The port answers before the aggregator has read its ledger.

use crate::Test;
use std::time::Duration;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::{TcpListener, TcpStream};
use tokio::time::timeout;
use tonic::transport::Endpoint;
use tonic::Code;
use zk0_aggregator::connections::listening::listen;
use zk0_aggregator::connections::starting::StartingServer;
use zk0_aggregator::start_progress::StartProgress;
use zk0_aggregator::ConnectionLimits;
use zk0_protocol::rpc::federation as proto;
use zk0_protocol::rpc::federation::federation_client::FederationClient;
use zk0_protocol::rpc::federation::turned_down::Remedy;
use zk0_protocol::rpc::health::health_check_response::ServingStatus;
use zk0_protocol::rpc::health::health_client::HealthClient;
use zk0_protocol::rpc::health::HealthCheckRequest;

#[tokio::test(flavor = "multi_thread")]
async fn a_start_answers_how_far_it_is_and_when_to_ask_again() -> Test {
    let listener = listen(([127, 0, 0, 1], 0).into())?.into_std()?;
    let address = listener.local_addr()?;
    let metrics = listen(([127, 0, 0, 1], 0).into())?.into_std()?;
    let progress = StartProgress::default();
    let limits = ConnectionLimits::default();
    let starting =
        StartingServer::begin(&listener, Some(&metrics), None, limits, progress.clone())?;
    let channel = Endpoint::try_from(format!("http://{address}"))?
        .connect()
        .await?;

    let mut client = FederationClient::new(channel.clone());
    for verified in [3, 10] {
        progress.note(verified, 10);
        let refused = client.get_network(proto::GetNetworkRequest {}).await;
        let refused = refused.err().ok_or("answered")?;
        assert_eq!(refused.code(), Code::Unavailable);
        let details = proto::TurnedDown::of(&refused);
        assert_eq!(details.remedy(), Remedy::AskAgain);
        assert!(details.after_ms > 0);
        let far = format!("{verified} of 10 entries are verified");
        assert!(refused.message().contains(&far), "{refused}");
    }
    progress.waits_for_witness();
    let refused = client.get_network(proto::GetNetworkRequest {}).await;
    let refused = refused.err().ok_or("answered")?;
    let waits = "waits for an answer of a witness";
    assert!(refused.message().contains(waits), "{refused}");
    let mut health = HealthClient::new(channel);
    let request = || HealthCheckRequest {
        service: String::new(),
    };
    let checked = health.check(request()).await?.into_inner();
    assert_eq!(checked.status(), ServingStatus::NotServing);
    let long = HealthCheckRequest {
        service: "long".repeat(1000),
    };
    let refused = health.check(long).await.err().ok_or("answered")?;
    assert!(refused.message().contains("too large"), "{refused}");
    let mut watched = health.watch(request()).await?.into_inner();
    let first = watched.message().await?.ok_or("no status")?;
    assert_eq!(first.status(), ServingStatus::NotServing);

    let mut stream = TcpStream::connect(metrics.local_addr()?).await?;
    let asks = b"GET /health HTTP/1.1\r\nhost: here\r\nconnection: close\r\n\r\n";
    stream.write_all(asks).await?;
    let mut answer = String::new();
    stream.read_to_string(&mut answer).await?;
    assert!(answer.starts_with("HTTP/1.1 503"), "{answer}");
    assert!(answer.contains(waits), "{answer}");

    // Then the aggregator has the port, with those who wait.
    drop((client, health, watched, stream));
    tokio::task::spawn_blocking(move || drop(starting)).await?;
    let waiting = TcpStream::connect(address).await?;
    let (_, peer) = TcpListener::from_std(listener)?.accept().await?;
    assert_eq!(peer, waiting.local_addr()?);
    Ok(())
}

#[tokio::test(flavor = "multi_thread")]
async fn a_start_has_the_limits_of_the_service() -> Test {
    let listener = listen(([127, 0, 0, 1], 0).into())?.into_std()?;
    let limits = ConnectionLimits {
        idle: Duration::from_millis(1),
        ..ConnectionLimits::default()
    };
    let progress = StartProgress::default();
    let starting = StartingServer::begin(&listener, None, None, limits, progress)?;
    let mut silent = TcpStream::connect(listener.local_addr()?).await?;
    // By default, it would have half a minute.
    let mut sent = Vec::new();
    let closed = silent.read_to_end(&mut sent);
    timeout(Duration::from_secs(15), closed).await??;
    tokio::task::spawn_blocking(move || drop(starting)).await?;
    Ok(())
}
