//! Has a claim proven. A commitment cannot be taken back, so the node asks a full or absent proving service again for as long as a proof
//! counts.

use crate::client::NodeClient;
use crate::error::{NoProof, ParticipantError};
use crate::observe::AskedService;
use crate::progress;
use std::sync::Arc;
use std::time::Duration;
use tokio::time::{sleep, timeout};
use zk0_protocol::entries::entry::RoundOpened;
use zk0_prover::program::GuestInput;
use zk0_prover::rpc;
use zk0_prover::service::ProvingClient;

/// Each further pause is twice as long.
const FIRST_PAUSE: Duration = Duration::from_secs(1);
const LONGEST_PAUSE: Duration = Duration::from_secs(30);

/// Has the claim of `input` proven in this round. The node asks again, and waits for the proof, only as long as the round takes
/// submissions: it must not be late for the next round, and leaves the service's queue to others.
///
/// # Errors
/// The service refuses the claim, or gives no proof in time; or the aggregator fails.
pub async fn have_proven(
    prover: &mut ProvingClient,
    node: &mut NodeClient,
    opened: &RoundOpened,
    input: GuestInput,
) -> Result<rpc::Proof, ParticipantError> {
    let (round, metrics) = (opened.round, node.metrics().clone());
    let input = Arc::new(input);
    let mut pause = FIRST_PAUSE;
    let mut reported: Option<String> = None;
    loop {
        let mut taken = false;
        let progress = |event: rpc::Progress| {
            taken = true;
            metrics.answered(AskedService::Prover);
            report(event);
        };
        let proven = tokio::select! {
            proven = prover.prove(input.clone(), progress) => proven,
            () = submissions_end(node, opened) => {
                let why = NoProof::Unfinished;
                return Err(ParticipantError::NoProofInTime { round, why });
            }
        };
        let error = match proven {
            Ok(proof) => {
                metrics.answered(AskedService::Prover);
                return Ok(proof);
            }
            Err(error) if error.may_pass() => error,
            Err(error) => return Err(error.into()),
        };
        if taken {
            // The service worked meanwhile: this is another failure.
            (pause, reported) = (FIRST_PAUSE, None);
        }
        // A further pause would end too late.
        if node.submissions_end_in(opened).await? <= pause {
            let why = NoProof::Failed(Box::new(error));
            return Err(ParticipantError::NoProofInTime { round, why });
        }
        let why = error.to_string();
        metrics.asks_again(AskedService::Prover, why.clone());
        match &reported {
            None => tracing::warn!(
                "round {round}: {why}. The node asks again while the round takes submissions, and goes on as soon as the service takes the claim"
            ),
            Some(before) if *before != why => tracing::info!("round {round}: no proof yet: {why}"),
            Some(_) => {}
        }
        reported = Some(why);
        sleep(pause).await;
        pause = pause.saturating_mul(2).min(LONGEST_PAUSE);
    }
}

/// Ready when the round takes no more submissions: after its whole window, if the aggregator is away.
async fn submissions_end(node: &mut NodeClient, opened: &RoundOpened) {
    let whole = Duration::from_millis(opened.rules.submit_window_ms);
    let mut is_first = true;
    while let Ok(left) = timeout(whole, node.submissions_end_in(opened)).await {
        // An outage may have moved the deadline meanwhile. A window that begins again and again is none.
        let left = left.unwrap_or(whole);
        if left.is_zero() || left >= whole && !is_first {
            return;
        }
        sleep(left).await;
        is_first = false;
    }
}

fn report(event: rpc::Progress) {
    let phase = match event.phase() {
        rpc::progress::Phase::Queued => "waiting for the prover",
        rpc::progress::Phase::Proving => "proving",
        // This phase takes a second, before the proof's time is known.
        _ => return,
    };
    let total = event.estimated_total_ms.max(event.elapsed_ms + 1);
    progress::report(phase, event.elapsed_ms, total, total - event.elapsed_ms);
}
