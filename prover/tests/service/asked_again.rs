//! Clients that go away and ask again: no claim is proven twice because of them.

use super::{comes, input, reaches, refusal, service, soon, Service, SOON};
use std::sync::atomic::Ordering;
use std::sync::Arc;
use tokio::time::timeout;
use zk0_circuits::Mode;
use zk0_prover::program::GuestInput;
use zk0_prover::rpc::progress::Phase;
use zk0_prover::service::ProvingClient;

impl Service {
    /// Has a proof begun, and goes away.
    async fn abandon(self: &Arc<Self>, claim: &'static str) {
        let (begun, gone) = (self.begun(), self.gone.load(Ordering::SeqCst));
        let abandoned = self.asking(claim);
        self.begins(begun + 1).await;
        abandoned.abort();
        reaches(&self.gone, gone + 1).await;
    }
}

#[tokio::test]
async fn a_proof_whose_client_went_away_is_there_when_it_asks_again() {
    let service = Arc::new(service(4, 0).await);
    service.abandon("claim").await;
    // No further proof may end.
    service.allowed.add_permits(1);
    let proof = soon(service.prove("claim")).await;
    assert_eq!(proof.proof, b"proof of claim");
    assert_eq!((proof.cycles, proof.gas), (1_000_000, 1_100_000));
    assert_eq!(service.begun(), 1);
}

#[tokio::test]
async fn who_asks_for_the_proof_that_is_being_made_waits_for_nothing_else() {
    let service = Arc::new(service(4, 0).await);
    service.abandon("claim").await;
    let other = service.asking_until("other", Phase::Queued).await;
    let allowed = service.allowed.clone();
    let mut heard = vec![];
    let proof = soon(service.prove_and_watch("claim", |event| {
        if event.phase() == Phase::Proving && event.elapsed_ms > 500 && heard.is_empty() {
            allowed.add_permits(1);
            heard.push(event);
        }
    }));
    assert_eq!(proof.await.proof, b"proof of claim");
    assert_eq!(heard[0].ahead, 0, "{heard:?}");
    // The other one is proven after it.
    service.begins(2).await;
    service.allowed.add_permits(1);
    comes(other).await;
    assert_eq!(service.begun(), 2);
}

#[tokio::test]
async fn a_full_queue_refuses_nobody_whose_proof_is_there_or_being_made() {
    let service = Arc::new(service(1, 0).await);
    service.abandon("claim").await;
    let first = service.asking_until("first", Phase::Queued).await;
    let second = service.asking_until("second", Phase::Queued).await;
    let third = refusal(service.prove("third").await);
    assert_eq!(third.0, tonic::Code::ResourceExhausted, "{third:?}");

    let again = service.asking_until("claim", Phase::Proving).await;
    service.allowed.add_permits(1);
    assert_eq!(comes(again).await.proof, b"proof of claim");
    // The first one of the others is being proven, and so the queue is still full.
    service.begins(2).await;
    assert_eq!(soon(service.prove("claim")).await.proof, b"proof of claim");
    service.allowed.add_permits(2);
    comes(first).await;
    comes(second).await;
    assert_eq!(service.begun(), 3);
}

#[tokio::test]
async fn who_waits_for_a_proof_that_fails_needs_a_place_as_everybody_does() {
    let service = Arc::new(service(0, 0).await);
    service.abandon("fail").await;
    let other = service.asking_until("other", Phase::Queued).await;
    let again = service.asking_until("fail", Phase::Proving).await;
    service.allowed.add_permits(1);
    let again = timeout(SOON, again).await;
    let (code, reason) = refusal(again.expect("it does not wait on").unwrap());
    assert_eq!(code, tonic::Code::ResourceExhausted);
    assert!(reason.contains("queue is full"), "{reason}");
    service.allowed.add_permits(1);
    comes(other).await;
}

/// Nobody went away, and the second request is behind another one in the queue.
#[tokio::test]
async fn a_request_that_comes_twice_is_answered_by_one_proof() {
    let service = Arc::new(service(4, 0).await);
    service.abandon("before").await;
    let first = service.asking_until("claim", Phase::Queued).await;
    let other = service.asking_until("other", Phase::Queued).await;
    let second = service.asking_until("claim", Phase::Queued).await;
    service.allowed.add_permits(2);
    comes(first).await;
    comes(second).await;
    service.allowed.add_permits(1);
    comes(other).await;
    assert_eq!(service.begun(), 3);
}

#[tokio::test]
async fn a_proof_that_fails_is_made_anew_for_who_waits_for_it() {
    let service = Arc::new(service(4, 0).await);
    service.abandon("fail").await;
    let again = service.asking_until("fail", Phase::Proving).await;
    service.allowed.add_permits(1);
    service.begins(2).await;
    service.allowed.add_permits(1);
    let again = timeout(SOON, again).await;
    assert!(again.expect("it ends").unwrap().is_err());
}

#[tokio::test]
async fn a_proof_that_nobody_took_outlives_those_that_are_taken() {
    let service = Arc::new(service(4, 0).await);
    service.abandon("claim").await;
    service.allowed.add_permits(1);
    for other in ["first", "second"] {
        service.allowed.add_permits(1);
        soon(service.prove(other)).await;
    }
    soon(service.prove("claim")).await;
    assert_eq!(service.begun(), 3);
}

/// Bytes that move from one buffer to the next, and another program, make another request. Each is compared with the one before it, whose
/// proof is the newest and so is kept.
#[tokio::test]
async fn a_proof_is_kept_for_the_same_request_alone() {
    let service = service(4, 3).await;
    let same = input(vec![b"ab".to_vec(), b"c".to_vec()]);
    let requests = [
        input(vec![b"a".to_vec(), b"bc".to_vec()]),
        same.clone(),
        GuestInput::new(Mode::Direct, same.buffers),
    ];
    for (before, request) in requests.into_iter().enumerate() {
        let first = request.buffers[0].clone();
        let mut client = ProvingClient::connect(service.address()).await.unwrap();
        let proof = soon(client.prove(request, |_| {})).await;
        assert_eq!(proof.public_values, first);
        assert_eq!(service.begun(), before + 1);
    }
}
