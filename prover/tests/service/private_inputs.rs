//! Private inputs on their way to the service: their form, their size, and how long they take.

use super::{patient_service, refusal, service, soon, Service, SOON};
use std::time::Duration;
use tokio::task::JoinSet;
use tokio::time::timeout;
use tokio_stream::{Stream, StreamExt};
use zk0_circuits::claim::program::verifying_key;
use zk0_circuits::Mode;
use zk0_prover::program::GuestInput;
use zk0_prover::rpc::prove_part::Part;
use zk0_prover::rpc::prover_client::ProverClient;
use zk0_prover::rpc::{prove_request, ProvePart, ProveRequest};
use zk0_prover::service::upload::{self, Announced, UploadTimeout, MAX_INPUT_BYTES};
use zk0_prover::service::ProvingClient;

/// Returns the service's answer to a request that the real client would not make.
async fn raw(parts: Vec<Part>) -> tonic::Status {
    let service = service(2, 1).await;
    let mut client = ProverClient::connect(service.address).await.unwrap();
    let parts = parts.into_iter().map(|part| ProvePart { part: Some(part) });
    let proof = client.prove(tokio_stream::iter(parts.collect::<Vec<_>>()));
    let proof = timeout(SOON, proof).await;
    proof.expect("the service answers").unwrap_err()
}

/// Announces private inputs of this release's program of mode `direct`.
fn announce(mode: prove_request::Mode, buffers: Vec<u64>) -> Part {
    Part::Request(ProveRequest {
        mode: mode.into(),
        program: verifying_key(Mode::Direct).to_vec(),
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

/// The node asks again until a release with the program is installed. A program of the other mode is another one.
#[tokio::test]
async fn a_claim_of_a_program_that_the_service_lacks_is_refused_until_it_has_it() {
    let service = service(0, 1).await;
    let of_other_mode = verifying_key(Mode::Succinct).to_vec();
    for program in [vec![2; 32], of_other_mode, vec![2; 1 << 20], vec![]] {
        let named = hex::encode(&program[..program.len().min(32)]);
        let input = GuestInput {
            program,
            ..GuestInput::new(Mode::Direct, vec![b"claim".to_vec()])
        };
        let mut client = ProvingClient::connect(service.address()).await.unwrap();
        let refused = timeout(SOON, client.prove(input, |_| {})).await.unwrap();
        let error = refused.unwrap_err();
        assert!(error.may_pass(), "{error}");
        let words = format!("which lacks the guest program {named}: install");
        assert!(error.to_string().contains(&words), "{error}");
    }
    assert_eq!(service.begun(), 0);
    service.prove("claim").await.unwrap();
}

/// Buffers of any size arrive as they were, whatever the cuts between messages.
#[tokio::test]
async fn a_large_private_input_arrives_whole() {
    let large: Vec<u8> = (0..5_000_001u32)
        .map(|i| (i.wrapping_mul(i) >> 7) as u8)
        .collect();
    for mode in Mode::ALL {
        let buffers = vec![large.clone(), vec![], vec![7; 3 << 20], vec![9]];
        let input = GuestInput::new(mode, buffers);
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
async fn who_sends_nothing_or_too_slowly_is_given_up() {
    let patience = UploadTimeout {
        silence: Duration::from_secs(2),
        whole: Duration::from_secs(6),
    };
    let service = patient_service(0, 1, patience).await;
    let silent = announcing(service.address.clone(), 9, tokio_stream::pending());
    let slow = tokio_stream::iter(std::iter::repeat(Part::Data(vec![1])));
    let slow = slow.throttle(Duration::from_millis(50));
    let slow = announcing(service.address.clone(), MAX_INPUT_BYTES, slow);
    let (silent, slow) = tokio::join!(timeout(SOON, silent), timeout(SOON, slow));
    for (status, why) in [
        (silent, "nothing of the private input came for"),
        (slow, "the private input took"),
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
    let mut silent = fill_the_memory(&service).await;
    service.stop.send(()).unwrap();
    let ended = timeout(SOON, service.served).await;
    ended.expect("it stops").unwrap();
    while let Some(told) = silent.join_next().await {
        let told = told.unwrap();
        assert_eq!(told.code(), tonic::Code::Unavailable, "{told}");
        assert!(told.message().contains("is stopping"), "{told}");
    }
}

/// Announces private inputs and never sends them. The service reserves the memory all the same, and has none for one of them. Returns the others.
async fn fill_the_memory(service: &Service) -> JoinSet<tonic::Status> {
    let mut all = JoinSet::new();
    for _ in 0..5 {
        let address = service.address.clone();
        all.spawn(announcing(
            address,
            MAX_INPUT_BYTES,
            tokio_stream::pending(),
        ));
    }
    let refused = timeout(SOON, all.join_next()).await;
    let refused = refused.expect("one of them is refused");
    let refused = refused.unwrap().unwrap();
    assert!(refused.message().contains("fill its memory"), "{refused}");
    all
}

#[tokio::test]
async fn private_inputs_that_fill_the_memory_are_refused_until_a_proof_is_done() {
    let service = service(16, 0).await;
    let mut waiting = fill_the_memory(&service).await;
    let (code, reason) = refusal(service.prove("claim").await);
    assert_eq!(code, tonic::Code::ResourceExhausted);
    assert!(reason.contains("fill its memory"), "{reason}");
    waiting.shutdown().await;
    service.allowed.add_permits(1);
    soon(service.prove_when_there_is_room("claim", |_| {})).await;
}
