//! A node waits for a proof for as long as the round takes submissions, and no longer.

use super::Told;
use std::time::Duration;
use tokio::net::TcpListener;
use tokio::time::timeout;
use zk0_circuits::Mode;
use zk0_node::error::{NoProof, ParticipantError};
use zk0_node::turn::proving::have_proven;
use zk0_protocol::rpc::federation as rpc;
use zk0_prover::program::{Execution, GuestInput};
use zk0_prover::prove::Proof;
use zk0_prover::service::{
    Backend, GivenUp, JobError, Pace, ProvingClient, ProvingService, WaitingClient,
};

/// Is never done with a proof.
struct Endless;

#[tonic::async_trait]
impl Backend for Endless {
    async fn start(&self) -> Result<(), JobError> {
        Ok(())
    }

    async fn check(&self, _: &GuestInput) -> Result<Execution, JobError> {
        Ok(Execution {
            public_values: vec![],
            cycles: 1,
            gas: 1,
        })
    }

    async fn prove(
        &self,
        _: &GuestInput,
        _: &Execution,
        waiting: &WaitingClient,
    ) -> Result<Proof, JobError> {
        waiting.stopping().await;
        Err(GivenUp::Stopping.into())
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_node_waits_for_no_proof_that_would_come_too_late() {
    let told = Told::new();
    let mut opened = told.opened.clone();
    opened.rules.submit_window_ms = 1000;
    let (mut node, aggregator) = told.connected(rpc::RoundInfo::default()).await;
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let address = format!("http://{}", listener.local_addr().unwrap());
    let service = ProvingService::start(Endless, 4, Pace::of_cores(2));
    let serving = tokio::spawn(async move {
        let served = service.serve(listener, std::future::pending()).await;
        served.unwrap();
    });
    let address = ProvingClient::address(address);
    let mut prover = ProvingClient::connect(address).await.unwrap();
    // The second claim waits in the queue, because the first one is still being proven.
    for claim in ["proven", "queued"] {
        let input = GuestInput::new(Mode::Direct, vec![claim.into()]);
        let proven = have_proven(&mut prover, &mut node, &opened, input);
        let proven = timeout(Duration::from_secs(20), proven).await;
        let error = proven.expect("the node waits on").err();
        assert!(
            matches!(
                error,
                Some(ParticipantError::NoProofInTime {
                    round: 0,
                    why: NoProof::Unfinished
                })
            ),
            "{claim}: {error:?}"
        );
    }
    aggregator.abort();
    serving.abort();
}
