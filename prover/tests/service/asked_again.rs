//! Clients that go away and ask again: no claim is proven twice because of them.

use crate::{input, service, Service};
use std::sync::atomic::Ordering;
use std::sync::Arc;
use std::time::Duration;
use tokio::task::JoinHandle;
use tokio::time::{sleep, timeout};
use zk0_circuits::Mode;
use zk0_prover::program::GuestInput;
use zk0_prover::rpc;
use zk0_prover::rpc::progress::Phase;
use zk0_prover::service::{ClientError, ProvingClient};

impl Service {
    fn begun(&self) -> usize {
        self.begun.load(Ordering::SeqCst)
    }

    /// Waits until so many proofs were begun.
    async fn begins(&self, proofs: usize) {
        let begins = async {
            while self.begun() < proofs {
                sleep(Duration::from_millis(10)).await;
            }
        };
        let begins = timeout(Duration::from_secs(10), begins).await;
        begins.expect("a proof is begun");
    }

    /// Has a proof begun, and goes away.
    async fn abandon(self: &Arc<Self>, claim: &'static str) {
        let before = self.begun();
        let abandoned = self.asking(claim);
        self.begins(before + 1).await;
        abandoned.abort();
        // Its end is waited for, so that the connection is closed.
        let _ = abandoned.await;
        sleep(Duration::from_millis(300)).await;
    }

    fn asking(
        self: &Arc<Self>,
        claim: &'static str,
    ) -> JoinHandle<Result<rpc::Proof, ClientError>> {
        let service = self.clone();
        tokio::spawn(async move { service.prove(claim).await })
    }

    /// Lets the proof end that is being made.
    async fn finish(&self) {
        self.allowed.add_permits(1);
        sleep(Duration::from_millis(300)).await;
    }
}

/// The proof, which has to come soon.
async fn soon(
    proof: impl std::future::Future<Output = Result<rpc::Proof, ClientError>>,
) -> rpc::Proof {
    let proof = timeout(Duration::from_secs(10), proof).await;
    proof.expect("the proof comes soon").unwrap()
}

#[tokio::test]
async fn a_proof_whose_client_went_away_is_there_when_it_asks_again() {
    let service = Arc::new(service(4, 0).await);
    service.abandon("claim").await;
    service.finish().await;
    // No further proof may end.
    let proof = soon(service.prove("claim")).await;
    assert_eq!(proof.proof, b"proof of claim");
    assert_eq!((proof.cycles, proof.gas), (1_000_000, 1_100_000));
    assert_eq!(service.begun(), 1);
}

#[tokio::test]
async fn who_asks_for_the_proof_that_is_being_made_waits_for_nothing_else() {
    let service = Arc::new(service(4, 0).await);
    service.abandon("claim").await;
    let other = service.asking("other");
    sleep(Duration::from_millis(300)).await;
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
    soon(async { other.await.unwrap() }).await;
    assert_eq!(service.begun(), 2);
}

#[tokio::test]
async fn a_proof_that_fails_is_made_anew_for_who_waits_for_it() {
    let service = Arc::new(service(4, 0).await);
    service.abandon("fail").await;
    let again = service.asking("fail");
    sleep(Duration::from_millis(300)).await;
    service.allowed.add_permits(1);
    service.begins(2).await;
    service.allowed.add_permits(1);
    let again = timeout(Duration::from_secs(10), again).await;
    assert!(again.expect("it ends").unwrap().is_err());
}

#[tokio::test]
async fn a_proof_that_nobody_took_outlives_those_that_are_taken() {
    let service = Arc::new(service(4, 0).await);
    service.abandon("claim").await;
    service.finish().await;
    for other in ["first", "second"] {
        service.allowed.add_permits(1);
        soon(service.prove(other)).await;
        sleep(Duration::from_millis(200)).await;
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
        GuestInput {
            mode: Mode::Direct,
            ..same
        },
    ];
    for (before, request) in requests.into_iter().enumerate() {
        let first = request.buffers[0].clone();
        let mut client = ProvingClient::connect(service.address()).await.unwrap();
        let proof = soon(client.prove(request, |_| {})).await;
        assert_eq!(proof.public_values, first);
        assert_eq!(service.begun(), before + 1);
    }
}
