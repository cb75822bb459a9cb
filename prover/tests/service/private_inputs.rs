//! Private inputs on their way to the service: their form, their size, and how long they take.

use crate::{patient_service, refusal, service};
use std::sync::Arc;
use std::time::Duration;
use tokio::time::{sleep, timeout};
use tokio_stream::{Stream, StreamExt};
use zk0_circuits::Mode;
use zk0_prover::program::GuestInput;
use zk0_prover::rpc::prove_part::Part;
use zk0_prover::rpc::prover_client::ProverClient;
use zk0_prover::rpc::{prove_request, ProvePart, ProveRequest};
use zk0_prover::service::upload::{self, Announced, Patience, MAX_INPUT_BYTES};

/// Returns the service's answer to a request that the real client would not make.
async fn raw(parts: Vec<Part>) -> tonic::Status {
    let service = service(2, 1).await;
    let mut client = ProverClient::connect(service.address).await.unwrap();
    let parts = parts.into_iter().map(|part| ProvePart { part: Some(part) });
    client
        .prove(tokio_stream::iter(parts.collect::<Vec<_>>()))
        .await
        .unwrap_err()
}

fn announce(mode: prove_request::Mode, buffers: Vec<u64>) -> Part {
    Part::Request(ProveRequest {
        mode: mode.into(),
        buffers,
    })
}

#[tokio::test]
async fn a_request_over_the_limits_is_refused_before_its_data_come() {
    use prove_request::Mode::Direct;
    for buffers in [
        vec![MAX_INPUT_BYTES + 1],
        vec![MAX_INPUT_BYTES, 1],
        vec![u64::MAX; 2],
        vec![0; 1 << 15],
    ] {
        let status = raw(vec![announce(Direct, buffers)]).await;
        assert_eq!(status.code(), tonic::Code::OutOfRange, "{status}");
        assert!(status.message().contains("too large"), "{status}");
    }
}

#[tokio::test]
async fn a_request_that_is_not_what_it_announces_is_refused() {
    use prove_request::Mode::{Direct, Unspecified};
    for (parts, why) in [
        (vec![], "begins with"),
        (vec![Part::Data(vec![1])], "begins with"),
        (vec![announce(Unspecified, vec![])], "no known mode"),
        (vec![announce(Direct, vec![1])], "fewer"),
        (
            vec![announce(Direct, vec![2]), Part::Data(vec![1])],
            "fewer",
        ),
        (
            vec![announce(Direct, vec![2]), announce(Direct, vec![2])],
            "fewer",
        ),
        (
            vec![announce(Direct, vec![1]), Part::Data(vec![1, 2])],
            "more",
        ),
        (vec![announce(Direct, vec![]), Part::Data(vec![1])], "more"),
    ] {
        let status = raw(parts).await;
        assert_eq!(status.code(), tonic::Code::InvalidArgument, "{status}");
        assert!(status.message().contains(why), "{status}");
    }
}

/// Buffers of any size arrive as they were, whatever the cuts between messages.
#[tokio::test]
async fn a_large_private_input_arrives_whole() {
    let large: Vec<u8> = (0..5_000_001u32)
        .map(|i| (i.wrapping_mul(i) >> 7) as u8)
        .collect();
    for mode in Mode::ALL {
        let input = GuestInput {
            mode,
            buffers: vec![large.clone(), vec![], vec![7; 3 << 20], vec![9]],
        };
        let mut parts = tokio_stream::iter(upload::parts(input.clone()).map(Ok));
        let announced = Announced::receive(&mut parts).await.unwrap();
        assert!(
            announced.rest(&mut parts).await.unwrap() == input,
            "it is another"
        );
    }
}

/// Announces a private input of so many bytes, and sends what follows. Returns why there is no proof.
async fn announcing(
    address: String,
    bytes: u64,
    more: impl Stream<Item = Part> + Send + 'static,
) -> tonic::Status {
    let mut client = ProverClient::connect(address).await.unwrap();
    let first = tokio_stream::once(announce(prove_request::Mode::Direct, vec![bytes]));
    let parts = first.chain(more);
    let parts = parts.map(|part| ProvePart { part: Some(part) });
    client.prove(parts).await.map(drop).unwrap_err()
}

#[tokio::test]
async fn who_sends_nothing_or_too_slowly_gives_up_its_place() {
    let patience = Patience {
        silence: Duration::from_millis(400),
        whole: Duration::from_millis(1500),
    };
    let service = patient_service(0, 1, patience).await;
    let silent = announcing(service.address.clone(), 9, tokio_stream::pending());
    let slow = tokio_stream::iter(std::iter::repeat(Part::Data(vec![1])));
    let slow = slow.throttle(Duration::from_millis(50));
    let slow = announcing(service.address.clone(), MAX_INPUT_BYTES, slow);
    // The second one comes when the first one has no place any more.
    for (status, why) in [
        (
            timeout(Duration::from_secs(20), silent).await,
            "nothing of the private input came for",
        ),
        (
            timeout(Duration::from_secs(20), slow).await,
            "the private input took",
        ),
    ] {
        let status = status.expect("the service waits on");
        assert_eq!(status.code(), tonic::Code::DeadlineExceeded, "{status}");
        assert!(status.message().contains(why), "{status}");
    }
    service.prove("claim").await.unwrap();
}

#[tokio::test]
async fn a_service_that_stops_waits_for_no_private_input() {
    let service = service(4, 0).await;
    let silent = announcing(
        service.address.clone(),
        MAX_INPUT_BYTES,
        tokio_stream::pending(),
    );
    let silent = tokio::spawn(silent);
    sleep(Duration::from_millis(500)).await;
    service.stop.send(()).unwrap();
    let ended = timeout(Duration::from_secs(4), service.served).await;
    ended.expect("it stops").unwrap();
    let told = silent.await.unwrap();
    assert_eq!(told.code(), tonic::Code::Unavailable, "{told}");
    assert!(told.message().contains("is stopping"), "{told}");
}

#[tokio::test]
async fn private_inputs_that_fill_the_memory_are_refused_until_a_proof_is_done() {
    let service = Arc::new(service(16, 0).await);
    let all_waiting: Vec<_> = (0..4)
        .map(|_| {
            // The client announces the input and never sends it. The service reserves the memory all the same.
            tokio::spawn(announcing(
                service.address.clone(),
                MAX_INPUT_BYTES,
                tokio_stream::pending(),
            ))
        })
        .collect();
    sleep(Duration::from_millis(500)).await;
    let (code, reason) = refusal(service.prove("claim").await);
    assert_eq!(code, tonic::Code::ResourceExhausted);
    assert!(reason.contains("fill its memory"), "{reason}");
    for waiting in all_waiting {
        waiting.abort();
    }
    sleep(Duration::from_millis(500)).await;
    service.allowed.add_permits(1);
    service.prove("claim").await.unwrap();
}
